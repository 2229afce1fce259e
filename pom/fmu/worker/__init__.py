"""Program of the child process of an FMU.

``python -m pom.fmu.worker MODEL.fmu FOLDER PARENT ...`` answers jobs until its input ends. From the
other rooms it imports only the math pilot, so that the child starts fast. A foreign library cannot
access the memory of the parent process.
"""

from flightmech.support.imports import attach_stub

# the parent, which reads replies only, needs no FMPy
__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
