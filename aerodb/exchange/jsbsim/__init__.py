"""JSBSim aircraft files."""
