"""Words of a bus or a frame to engineering values."""
