"""DAVE-ML (ANSI/AIAA S-119): files read, evaluated and checked; to and from databases."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flightmech.support.lazy import load

if TYPE_CHECKING:
    from .document.model import DaveModel
    from .document.reading import read
    from .from_database.exporter import export_daveml
    from .to_database.importer import import_daveml

_HOME = {
    "DaveModel": "document.model",
    "export_daveml": "from_database.exporter",
    "import_daveml": "to_database.importer",
    "read": "document.reading",
}
__all__ = ["DaveModel", "export_daveml", "import_daveml", "read"]


def __getattr__(name: str):
    return load(__name__, _HOME, name)


def __dir__() -> list[str]:
    return __all__
