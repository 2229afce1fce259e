"""Models with parameters that they are not linear in: expressions, their derivatives, their text."""
