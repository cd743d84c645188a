"""Noise with memory: how its variance is spread over the frequencies."""
