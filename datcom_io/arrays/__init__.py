"""Printed tables as arrays in SI and radians."""
