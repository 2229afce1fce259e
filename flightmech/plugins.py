"""Readers and exporters that other packages add, by the entry points of their distributions.

A distribution declares, for example, ``[project.entry-points."aeromatch.database_exporters"]``
with one line per format, ``name = "module:function"``. The product's own formats need no entry
point, and a foreign one cannot replace them.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from flightmech.errors import AeromatchError, AeromatchWarning

RECORD_READERS = "aeromatch.record_readers"
DATABASE_EXPORTERS = "aeromatch.database_exporters"
DATABASE_IMPORTERS = "aeromatch.database_importers"
_OBJECTS = {
    RECORD_READERS: "reader",
    DATABASE_EXPORTERS: "exporter",
    DATABASE_IMPORTERS: "importer",
}
# A package may end the process in its code, for example without a licence.
_FAILURES = (Exception, SystemExit)


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
    except _FAILURES as error:
        raise AeromatchError(
            f"the entry point {point.name!r} of {_distribution(point)} cannot be loaded from "
            f"{point.value!r}: {type(error).__name__}: {error}; repair or uninstall that package"
        ) from error


def recognise_plugin(group: str, path: str | Path, head: bytes, own: Collection[str] = ()) -> str:
    """Return the name of the first entry point of a group that reads a file, empty without one.

    Parameters
    ----------
    group : str
        `RECORD_READERS` or `DATABASE_IMPORTERS`, whose objects have ``recognise(path, head)``.
    path : str or Path
    head : bytes
        First bytes of the file.
    own : collection of str
        Names of the product's own formats.

    Warns
    -----
    AeromatchWarning
        An entry point cannot be loaded, or fails while it looks at the file. It is left out, so
        that one broken package does not stop the reading of every file.
    """
    for name, point in find_plugins(group, own).items():
        try:
            plugin = load_plugin(point)
        except AeromatchError as error:
            warnings.warn(f"left out: {error}", AeromatchWarning, stacklevel=2)
            continue
        try:
            is_recognised = bool(plugin.recognise(Path(path), head))
        except _FAILURES as error:
            failure = _plugin_failure(group, name, path, error)
            warnings.warn(f"left out: {failure}", AeromatchWarning, stacklevel=2)
            continue
        if is_recognised:
            return name
    return ""


def read_by_plugin(group: str, name: str, path: str | Path, **options: Any) -> Any:
    """Return what the function ``read`` of an entry point returns for a file.

    Parameters
    ----------
    group, name : str
        As `recognise_plugin` takes and returns them.
    path : str or Path
    **options
        Keyword arguments of ``read``.

    Raises
    ------
    AeromatchError
        The function fails; the error names the entry point and the file.
    """
    plugin = load_plugin(find_plugins(group)[name])
    try:
        return plugin.read(path, **options)
    except _FAILURES as error:
        raise _plugin_failure(group, name, path, error) from error


def _plugin_failure(
    group: str, name: str, path: str | Path, error: BaseException
) -> AeromatchError:
    """Return the error of an entry point that fails at a file."""
    return AeromatchError(
        f"the {_OBJECTS[group]} {name!r} of another package fails at {path}: "
        f"{type(error).__name__}: {error}; repair or uninstall that package"
    )


def _warn_left_out(point: EntryPoint, reason: str) -> None:
    text = (
        f"the entry point {point.name!r} = {point.value!r} of {_distribution(point)} is left out: "
        f"{reason}"
    )
    warnings.warn(text, AeromatchWarning, stacklevel=3)


def _distribution(point: EntryPoint) -> str:
    return repr(point.dist.name) if point.dist else "an unknown distribution"
