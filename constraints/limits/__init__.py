"""The limits: each module declares one as ``LIMIT``, or several as ``LIMITS``."""
