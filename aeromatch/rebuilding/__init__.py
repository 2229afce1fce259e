"""Stored products of a match, and the record of a finished match that makes a repetition
unnecessary.
"""
