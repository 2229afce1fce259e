"""Faults of a recording: exchanged surfaces, constant errors and lost samples."""
