"""What disturbs a measurement beside its noise, one concept per file."""
