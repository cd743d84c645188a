"""What a comparison says of several run folders."""
