"""Which terms explain a mismatch."""
