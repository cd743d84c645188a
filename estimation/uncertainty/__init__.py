"""How sure one may be: intervals, what is identified, and the bound that no estimator beats."""
