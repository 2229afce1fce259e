"""Control loading from flight: friction, preload, masses, cables and hinge moments of column, wheel and pedals."""
