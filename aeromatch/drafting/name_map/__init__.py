"""Name map of recordings: quantity, unit and sign of every channel."""
