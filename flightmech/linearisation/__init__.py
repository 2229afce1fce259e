"""The linear model about a steady flight, and its modes."""
