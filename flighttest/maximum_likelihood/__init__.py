"""Maximum likelihood over whole responses: output error in time and in frequency, filter error.

Public names are offered by `flighttest` itself.
"""
