"""Which terms a coefficient needs: stepwise regression and multivariate orthogonal functions, in time and in frequency."""
