"""The aerodynamic database: built from DATCOM, checked, edited, compared, stored.

A database is an ``xarray.DataTree``; every leaf ``/<coefficient>/<contribution>`` is one term of the model as
`flightmech.terms` defines it.  ``docs/aero-model.md`` tells what the terms mean.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flightmech.lazy import load

if TYPE_CHECKING:
    from . import templates
    from .blending import blend, consistency
    from .build import from_datcom
    from .comparison import compare
    from .edit import delete_terms, replace_terms
    from .evaluation import contributions, evaluate
    from .exchange.daveml.exporting import export_daveml
    from .exchange.daveml.importing import import_daveml
    from .exchange.jsbsim_write import export_jsbsim
    from .factoring import factored
    from .files import open, save
    from .moving import move_reference
    from .overview import summary
    from .rescaling import rescale
    from .schema import check, database, terms
    from .shaping import extend, regrid, regrid_error, scale, shift
    from .states import forget, history, previous
    from .tabulation import tabulate

_HOME = {
    "export_daveml": "exchange.daveml.exporting",
    "import_daveml": "exchange.daveml.importing",
    "blend": "blending",
    "consistency": "blending",
    "move_reference": "moving",
    "extend": "shaping",
    "regrid": "shaping",
    "regrid_error": "shaping",
    "scale": "shaping",
    "shift": "shaping",
    "forget": "states",
    "history": "states",
    "previous": "states",
    "from_datcom": "build",
    "compare": "comparison",
    "delete_terms": "edit",
    "replace_terms": "edit",
    "contributions": "evaluation",
    "evaluate": "evaluation",
    "open": "files",
    "save": "files",
    "export_jsbsim": "exchange.jsbsim_write",
    "check": "schema",
    "database": "schema",
    "terms": "schema",
    "rescale": "rescaling",
    "summary": "overview",
    "factored": "factoring",
    "tabulate": "tabulation",
    "templates": "templates",
}
__all__ = [
    "blend",
    "check",
    "compare",
    "consistency",
    "contributions",
    "database",
    "delete_terms",
    "evaluate",
    "export_daveml",
    "export_jsbsim",
    "extend",
    "factored",
    "forget",
    "from_datcom",
    "history",
    "import_daveml",
    "move_reference",
    "open",
    "previous",
    "regrid",
    "regrid_error",
    "replace_terms",
    "rescale",
    "save",
    "scale",
    "shift",
    "summary",
    "tabulate",
    "templates",
    "terms",
]


def __getattr__(name: str):
    return load(__name__, _HOME, name)


def __dir__() -> list[str]:
    return __all__
