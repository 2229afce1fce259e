"""Databases, identification and the diagnosis in the report."""
