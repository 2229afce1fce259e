"""Ground effect from landings, low passes and free-air records, [LR743] 4.5.1."""
