"""Runs of the user's own DATCOM program: a study split into decks, and run."""
