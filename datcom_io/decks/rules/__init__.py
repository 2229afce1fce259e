"""Rules that an input deck is checked against."""
