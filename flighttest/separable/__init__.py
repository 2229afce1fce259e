"""Models that are linear in most parameters and nonlinear in a few: separable least squares."""
