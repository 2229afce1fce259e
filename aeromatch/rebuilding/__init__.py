"""A match as a build: products as stages that are kept, and the record of a finished match by which
nothing is done again.
"""
