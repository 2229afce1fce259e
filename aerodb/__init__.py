"""The aerodynamic database: built from DATCOM, checked, edited, compared, stored.

A database is an ``xarray.DataTree``; every leaf ``/<coefficient>/<contribution>`` is one term of
the model as
`flightmech.terms` defines it.  ``docs/explanation/database/aero-model.md`` defines the terms."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
