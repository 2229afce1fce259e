"""Edits by hand: terms, tables, blending; every edit is recorded."""
