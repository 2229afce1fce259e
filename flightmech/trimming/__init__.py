"""Steady flight of a compiled model: request, search, result."""
