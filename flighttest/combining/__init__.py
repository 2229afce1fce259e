"""Estimates of several manoeuvres, bins and sources combined."""
