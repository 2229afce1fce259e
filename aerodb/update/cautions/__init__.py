"""Warnings on fits that a database cannot take as they are: terms without a place, and fits that
contradict each other.
"""
