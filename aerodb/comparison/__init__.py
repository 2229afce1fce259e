"""Databases compared, on a grid or along a flight record."""
