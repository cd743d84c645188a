"""The design as a nonlinear program: stated here, solved elsewhere."""
