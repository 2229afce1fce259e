"""The report on paper: a tagged PDF/A-3 document, typeset by typst, its panels drawn by our own SVG writer."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flightmech.support.lazy import load

if TYPE_CHECKING:
    from .document import pdf_pages

_HOME = {"pdf_pages": "document"}
__all__ = ["pdf_pages"]


def __getattr__(name: str):
    return load(__name__, _HOME, name)


def __dir__() -> list[str]:
    return __all__
