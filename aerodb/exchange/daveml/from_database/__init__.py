"""A database as a DAVE-ML file."""
