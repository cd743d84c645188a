"""What is too long for the tests: measured by `make bench`, written as tables."""
