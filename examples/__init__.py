"""Examples on the public functions of the packages."""
