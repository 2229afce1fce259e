"""Printed tables: cells, columns, rows, layouts, and what a page and a case hold."""
