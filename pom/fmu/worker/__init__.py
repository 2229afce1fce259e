"""What runs in the child process of an FMU: ``python -m pom.fmu.worker MODEL.fmu FOLDER PARENT`` answers jobs until its input ends.

Of the rest of the package it imports the math pilot only, so that the child starts fast and a foreign library cannot reach the parent.
"""

from .model import Model
from .run import replay

__all__ = ["Model", "replay"]
