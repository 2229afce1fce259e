"""Stated values of a flight that no aeroplane has: mostly numbers without their unit."""
