"""A second estimator: the vortex lattice of AVL for the geometry of a DATCOM deck."""
