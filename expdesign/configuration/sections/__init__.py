"""The sections of a run file, one type each."""
