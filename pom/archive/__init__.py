"""Results kept: the file, its manifest, provenance, verification."""
