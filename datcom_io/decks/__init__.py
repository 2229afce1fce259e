"""Input decks of Digital DATCOM: read, written, checked, split into runs and run."""
