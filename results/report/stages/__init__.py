"""What a report says of each stage of a run."""
