"""A whole flight against what is known of the aeroplane: consistency, stationary points, coefficients, eigenmotions, bounds."""
