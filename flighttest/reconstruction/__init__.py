"""State reconstruction: from recordings to one consistent flight path ([LR743] 4.3)."""
