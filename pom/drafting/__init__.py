"""A first case file for a record."""
