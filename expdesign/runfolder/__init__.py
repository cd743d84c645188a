"""The run folder: files that are complete or absent, and what made them."""
