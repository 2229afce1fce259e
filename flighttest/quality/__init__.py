"""Data quality: what is right and wrong with a flight record, as findings with names, as text, JSON and one HTML page."""
