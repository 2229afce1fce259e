"""Faults of the samples of records before a match: gaps, and values that are held."""
