"""What is shown of a run: tables, figures and reports. Computes nothing that a run decides."""
