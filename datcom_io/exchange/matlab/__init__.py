"""The structure of MATLAB's ``datcomimport``."""
