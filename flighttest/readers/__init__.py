"""Readers of recordings, one module for each format; `flighttest.readers.opening` chooses by content."""
