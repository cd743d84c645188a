"""The executed motion from measured lengths: by Fourier series, or pointwise."""
