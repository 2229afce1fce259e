"""Checks of the command line, before a command works."""
