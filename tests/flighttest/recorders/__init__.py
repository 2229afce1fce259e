"""Writers of recordings, made from the published descriptions of the formats and knowing nothing of
the readers.
"""
