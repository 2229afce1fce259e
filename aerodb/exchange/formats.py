"""Table of the formats of a database file, and of the functions that read and write them.

Other packages add formats by entry points (`flightmech.plugins`). An exporter is a function
``export(tree, path)``. An importer is an object with ``recognise(path, head)``, which returns
whether it reads this file, and ``read(path)``, which returns the database.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

from aerodb.exchange.recognition import HEAD, recognise_own_format
from flightmech.errors import AeromatchError, ParseError
from flightmech.plugins import (
    DATABASE_EXPORTERS,
    DATABASE_IMPORTERS,
    find_plugins,
    load_plugin,
    read_by_plugin,
    recognise_plugin,
)

# format: module and function
EXPORTERS = {
    "netcdf": ("aerodb.store.files", "save"),
    "jsbsim": ("aerodb.exchange.jsbsim.write", "export_jsbsim"),
    "daveml": ("aerodb.exchange.daveml.exporter", "export_daveml"),
    "matlab": ("aerodb.exchange.tables.matlab", "export_matlab"),
    "csv": ("aerodb.exchange.tables.csv_terms", "export_csv"),
    "checkcases": ("aerodb.exchange.tables.csv_checks", "export_checkcases"),
}
IMPORTERS = {
    "netcdf": ("aerodb.store.files", "open"),
    "jsbsim": ("aerodb.exchange.jsbsim.read", "import_jsbsim"),
    "daveml": ("aerodb.exchange.daveml.importer", "import_daveml"),
    "matlab": ("aerodb.exchange.tables.matlab", "import_matlab"),
    "csv": ("aerodb.exchange.tables.csv_terms", "import_csv"),
}


def find_exporter(name: str) -> Callable[..., Any]:
    """Return the function that writes a format.

    Raises
    ------
    AeromatchError
        Neither the product nor an entry point has the format.
    """
    if name in EXPORTERS:
        return _load_function(EXPORTERS[name])
    plugins = find_plugins(DATABASE_EXPORTERS, EXPORTERS)
    if name not in plugins:
        allowed = ", ".join([*EXPORTERS, *plugins])
        raise AeromatchError(f"a database has no export format {name!r}; use one of {allowed}")
    return load_plugin(plugins[name])


def find_importer(name: str) -> Callable[..., xr.DataTree]:
    """Return the function that reads a format which `recognise_format` returned."""
    if name in IMPORTERS:
        return _load_function(IMPORTERS[name])
    return partial(read_by_plugin, DATABASE_IMPORTERS, name)


def recognise_format(path: Path) -> str:
    """Return the format of a file or folder: netcdf, matlab, jsbsim, daveml, csv, or a plug-in's.

    The product's own formats come first; a plug-in is asked about any other file.

    Raises
    ------
    ParseError
        Neither the product nor an entry point reads the file.

    Warns
    -----
    AeromatchWarning
        An entry point cannot be loaded, or fails while it looks at the file; it is left out.
    """
    try:
        return recognise_own_format(path)
    except ParseError:
        head = b""
        if path.is_file():
            with path.open("rb") as file:
                head = file.read(HEAD)
        name = recognise_plugin(DATABASE_IMPORTERS, path, head, own=IMPORTERS)
        if not name:
            raise
        return name


def _load_function(place: tuple[str, str]) -> Callable[..., Any]:
    module, function = place
    return getattr(importlib.import_module(module), function)
