"""Thrust and power of propellers, and the dynamics of their shafts, from flight."""
