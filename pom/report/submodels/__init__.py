"""Submodels identified from flight: engine, control loading, ground effect, as sections for page
and paper.
"""
