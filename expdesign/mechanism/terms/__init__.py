"""Terms of the regressor: every module declares one block (see `expdesign.mechanism.term`)."""
