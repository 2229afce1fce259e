"""Engine identified from flight: governor and spools, static thrust, start and shut-down, [LR743] 4.5.2."""
