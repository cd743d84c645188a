"""Reports: one self-contained page per run folder, and one per comparison of several."""
