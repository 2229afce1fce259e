"""A-priori databases of several sources, joined by the covariance of their errors."""
