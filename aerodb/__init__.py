"""The aerodynamic database: built from DATCOM, checked, edited, compared, stored.

A database is an ``xarray.DataTree``; every leaf ``/<coefficient>/<contribution>`` is one term of the model as
`flightmech.terms` defines it.  ``docs/aero-model.md`` tells what the terms mean.
"""

from __future__ import annotations

import importlib
import sys
import types
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .build import from_datcom
    from .compare import compare
    from .edit import delete_terms, replace_terms
    from .evaluate import contributions, evaluate
    from .files import open, save
    from .schema import check, database, terms
    from .summary import summary
    from .tabulate import tabulate

_HOME = {
    "from_datcom": "build",
    "compare": "compare",
    "delete_terms": "edit",
    "replace_terms": "edit",
    "contributions": "evaluate",
    "evaluate": "evaluate",
    "open": "files",
    "save": "files",
    "check": "schema",
    "database": "schema",
    "terms": "schema",
    "summary": "summary",
    "tabulate": "tabulate",
}
__all__ = [
    "check",
    "compare",
    "contributions",
    "database",
    "delete_terms",
    "evaluate",
    "from_datcom",
    "open",
    "replace_terms",
    "save",
    "summary",
    "tabulate",
    "terms",
]


class _Package(types.ModuleType):
    """The package itself: a function wins over the module of the same name, which the import system would bind."""

    def __setattr__(self, name: str, value) -> None:
        if not (name in _HOME and isinstance(value, types.ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str):
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
