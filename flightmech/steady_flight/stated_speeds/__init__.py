"""Stated speeds of a flight that are far outside of the tables of a model."""
