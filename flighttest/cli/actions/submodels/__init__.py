"""Functions that perform the commands of `flighttest.cli.submodels`."""
