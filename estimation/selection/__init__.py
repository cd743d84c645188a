"""Which terms the data support: steps over blocks of the regressor, judged with the noise's law."""
