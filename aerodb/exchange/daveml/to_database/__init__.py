"""A DAVE-ML model as a database."""
