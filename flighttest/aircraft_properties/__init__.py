"""Inertia, thrust and eigenmotions of the aircraft from flight."""
