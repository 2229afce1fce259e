"""Likelihood fits as netCDF files."""

from __future__ import annotations

import os
from pathlib import Path

import xarray as xr

from flightmech.support.atomic_write import written_atomically

from ..equation_error.fit import open_tree
from .result import OutputError

_CONTENT = "output error"


def save_output_error(fit: OutputError, path: str | os.PathLike) -> None:
    """Write a fit in time to a netCDF-4 file, atomically.

    Groups ``estimates`` (with the report as attribute), ``noise`` and ``residuals/1`` ... for each manoeuvre.

    Parameters
    ----------
    fit : OutputError
        Of `output_error` or `filter_error`; complex residuals of a fit in frequency have no place in such a file.
    path : path
        An older file is replaced.
    """
    groups = {
        "/": xr.Dataset(attrs={"content": _CONTENT, "warnings": "\n".join(fit.warnings)}),
        "/estimates": fit.estimates.assign_attrs(report=fit.report()),
        "/noise": fit.noise,
        **{f"/residuals/{number}": rest for number, rest in enumerate(fit.residuals, start=1)},
    }
    with written_atomically(Path(path)) as part:
        xr.DataTree.from_dict(groups).to_netcdf(part, engine="h5netcdf", mode="w")


def open_output_error(path: str | os.PathLike) -> OutputError:
    """Read a fit that `save_output_error` wrote.

    Raises
    ------
    ParseError
        Not such a file.
    """
    tree = open_tree(path, _CONTENT, "a fit as `aeromatch flight fit -o` writes it")
    rest = tree["residuals"].children
    residuals = tuple(rest[name].to_dataset(inherit=False) for name in sorted(rest, key=int))
    estimates, noise = (tree.children[name].to_dataset(inherit=False) for name in ("estimates", "noise"))
    warnings = tuple(str(tree.attrs.get("warnings", "")).splitlines())
    return OutputError(estimates, residuals, noise, warnings)
