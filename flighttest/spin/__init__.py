"""Spin: rates about and beside the flight path, model structures, polynomial models as databases, simulated recordings."""
