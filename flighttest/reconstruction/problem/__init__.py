"""The least-squares problem of the flight path."""
