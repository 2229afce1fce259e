"""Conditions that a row of the tolerance table states for its flight, and their checks."""
