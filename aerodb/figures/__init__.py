"""Figures of databases."""
