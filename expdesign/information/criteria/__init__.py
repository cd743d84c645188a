"""One criterion per file; each declares its ``CRITERION``."""
