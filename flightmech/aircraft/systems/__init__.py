"""Systems of the aircraft as data: engines, fuel, control circuits, landing gear."""
