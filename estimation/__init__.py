"""Estimation of the parameters from measurements taken along a designed trajectory."""
