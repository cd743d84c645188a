"""Prediction of motions that were not used for the estimate."""
