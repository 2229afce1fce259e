"""Records, cases and flight conditions of a plot file (unit 13)."""
