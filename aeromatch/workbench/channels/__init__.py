"""Channels of a record on the screen: expressions of them, spectra, cursors, one over another."""
