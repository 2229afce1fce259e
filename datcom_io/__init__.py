"""Digital DATCOM listings: as printed, and as xarray trees in SI and radians.

>>> import datcom_io
>>> listing = datcom_io.read("t37_clean.out")           # doctest: +SKIP
>>> listing.case_names                                  # doctest: +SKIP
['T-37 OWN DECK CLEAN AIRCRAFT']

The printed table, with its units in ``attrs``:

>>> listing[0].block("static")                          # doctest: +SKIP

The same in SI and radians, under canonical names:

>>> clean = listing[0].to_datatree()                    # doctest: +SKIP
>>> clean["static"]["CL"].sel(condition=0)              # doctest: +SKIP
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
