"""Rows of a proof of match before the flights: their cases on the a-priori model, and the gradients
of their results by the nodes of a database.
"""
