"""Other files of Digital DATCOM and its neighbours: plot files, CSV of DATCOM+, the MATLAB
structure.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
