"""Steady performance of an engine: thrust, fuel flow and turbine temperature of settled points and of whole flights."""
