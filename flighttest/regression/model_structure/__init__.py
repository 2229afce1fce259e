"""Which terms a coefficient needs: stepwise regression and multivariate orthogonal functions, in
time and in frequency.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
