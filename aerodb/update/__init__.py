"""Flight estimates joined with the a-priori tables, and the standard errors of the result."""
