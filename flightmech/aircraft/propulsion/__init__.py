"""Parts of an engine: the deck of a gas turbine, propeller, piston engine, electric motor."""
