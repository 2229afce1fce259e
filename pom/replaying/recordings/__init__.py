"""Recordings of a device compared with the flight: inputs, sizes and signs."""
