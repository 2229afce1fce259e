"""Linear models of coefficients by least squares, in time and in frequency."""
