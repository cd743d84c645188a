"""The motion that a machine executes: from rest at home, through the periods, back to rest."""
