"""Checks of the instruments of the aircraft file: their places and the sizes of their errors."""
