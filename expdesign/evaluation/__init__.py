"""The symbolic graph of one instant, evaluated for many of them."""
