"""Files of a run folder, read strictly: one module per file, one frozen object each."""
