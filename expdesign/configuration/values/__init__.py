"""Values in YAML files: quantities with units, names, numbers, choices and lists."""
