"""Weights of the parts of the prior covariance, and of the fits, by their likelihood."""
