"""Performance: stall, drag polar, glide, level flight, range, climb ([LR743] section 2.2)."""
