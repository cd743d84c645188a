"""The motion that a machine executes: lead-in from rest at home, periods, lead-out."""
