"""The figures of an executable motion: every module declares one as ``FIGURE``."""
