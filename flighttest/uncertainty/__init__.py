"""Standard errors with autocorrelated residuals, collinearity, measures of fit."""
