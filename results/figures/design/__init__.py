"""The figures of a design: every module declares one as ``FIGURE``."""
