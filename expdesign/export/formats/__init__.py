"""One file for each format of controller tables."""
