"""Validity envelope of a model: where flights support it, and where they do not."""
