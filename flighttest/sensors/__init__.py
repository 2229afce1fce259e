"""Instruments: specification, corrections of position, air data."""
