"""Selection of the model terms that the data support, block by block of the regressor."""
