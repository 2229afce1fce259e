"""Flight records: read, joined, listed and written."""
