"""Design of test inputs: multisines, multisteps, sweeps; predicted response, expected accuracy, files to play."""
