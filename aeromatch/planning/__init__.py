"""The plan of a match: steps, records, fits, cases and products, and every problem before the first
computation.
"""
