"""Filter error of the non-linear simulation: an extended Kalman filter along the kernel."""
