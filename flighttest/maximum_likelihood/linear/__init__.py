"""Likelihood of linear models: output error in time and in frequency, filter error, gusts."""
