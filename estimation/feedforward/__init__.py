"""What the identified model buys: the twin under a position controller, with and without it."""
