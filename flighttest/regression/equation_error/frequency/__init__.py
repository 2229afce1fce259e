"""Regression of Fourier transforms, with weights by the spectrum of the disturbance."""
