"""Design of test inputs: multisines, multisteps, sweeps; predicted response, expected accuracy,
files to play.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
