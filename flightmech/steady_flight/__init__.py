"""A trimmed condition with its coefficients and derivatives, on which characteristics are built."""
