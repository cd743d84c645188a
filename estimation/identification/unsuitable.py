"""Recordings that cannot be used as they are."""

from __future__ import annotations

from expdesign.configuration import InputError


class UnsuitableDataError(InputError):
    """It is the recording that does not fit, not what the run says: another one may."""
