"""Databases in the formats of other programs."""
