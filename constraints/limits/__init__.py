"""One limit per file; each declares its ``LIMIT``."""
