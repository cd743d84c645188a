"""File formats of measurements: each module declares its ``FORMATS``."""
