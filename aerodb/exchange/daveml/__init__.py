"""DAVE-ML (ANSI/AIAA S-119): files read, evaluated and checked; to and from databases."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flightmech.lazy import load

if TYPE_CHECKING:
    from .exporting import export_daveml
    from .importing import import_daveml
    from .model import DaveModel
    from .reading import read

_HOME = {"DaveModel": "model", "export_daveml": "exporting", "import_daveml": "importing", "read": "reading"}
__all__ = ["DaveModel", "export_daveml", "import_daveml", "read"]


def __getattr__(name: str):
    return load(__name__, _HOME, name)


def __dir__() -> list[str]:
    return __all__
