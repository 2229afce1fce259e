"""Readers and exporters that other packages add, by the entry points of their distributions.

A distribution declares, for example, ``[project.entry-points."aeromatch.database_exporters"]``
with one line per format, ``name = "module:function"``. The product's own formats need no entry
point, and a foreign one cannot replace them.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from flightmech.errors import AeromatchError, AeromatchWarning

RECORD_READERS = "aeromatch.record_readers"
DATABASE_EXPORTERS = "aeromatch.database_exporters"
DATABASE_IMPORTERS = "aeromatch.database_importers"


def find_plugins(group: str, own: Collection[str] = ()) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name, sorted, without those that cannot be used.

    Parameters
    ----------
    group : str
        `RECORD_READERS`, `DATABASE_EXPORTERS` or `DATABASE_IMPORTERS`.
    own : collection of str
        Names of the product's own formats.

    Warns
    -----
    AeromatchWarning
        An entry point has the name of a format of the product, or of another entry point. It is
        left out.
    """
    plugins: dict[str, EntryPoint] = {}
    for point in sorted(entry_points(group=group), key=lambda point: (point.name, point.value)):
        if point.name in own:
            _warn_left_out(point, "the product has a format of this name")
        elif point.name in plugins:
            other = plugins[point.name]
            # an editable and a regular installation list the same object twice
            if other.value != point.value:
                _warn_left_out(point, f"{other.value!r} has the same name")
        else:
            plugins[point.name] = point
    return plugins


def load_plugin(point: EntryPoint) -> Any:
    """Return the object of an entry point.

    Raises
    ------
    AeromatchError
        Its module cannot be imported, or does not hold the object.
    """
    try:
        return point.load()
    except Exception as error:
        raise AeromatchError(
            f"the entry point {point.name!r} of {_distribution(point)} cannot be loaded from "
            f"{point.value!r}: {type(error).__name__}: {error}; repair or uninstall that package"
        ) from error


def _warn_left_out(point: EntryPoint, reason: str) -> None:
    text = (
        f"the entry point {point.name!r} = {point.value!r} of {_distribution(point)} is left out: "
        f"{reason}"
    )
    warnings.warn(text, AeromatchWarning, stacklevel=3)


def _distribution(point: EntryPoint) -> str:
    return repr(point.dist.name) if point.dist else "an unknown distribution"
