"""Public names of `flightmech.fmu_export`."""

from .fmu_file import write_fmu as write_fmu
from .fmu_reading import read_fmu as read_fmu
