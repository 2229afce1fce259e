"""A database for another reference, size, grid or height above ground."""
