"""The report on paper: a tagged PDF/A-3 document, typeset by typst, its panels drawn by our own SVG
writer.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
