"""Files of fits: writing, reading, and the search for contradictions in what was read."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import xarray as xr

from flightmech.errors import (
    ParseError,
)
from flightmech.support.array_files.netcdf_writing import write_netcdf
from flightmech.support.atomic_write import written_atomically
from flightmech.support.hdf5_seal import decoding_errors, demand_self_contained
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.model import RegressionModel

_CONTENT = "aeromatch fit"
_EXPECTED = "a fit as `aeromatch flight identify -o` writes it"


def save_fit(fit: Fit, path: str | os.PathLike) -> None:
    """Write a fit to a netCDF-4 file, atomically.

    Parameters
    ----------
    fit : Fit
    path : path
        An existing file is replaced.
    """
    path = Path(path)
    attributes = {
        "content": _CONTENT,
        "name": fit.name,
        "model": str(fit.model),
        "reference": json.dumps(dict(fit.model.reference)),
    }
    tree = xr.DataTree.from_dict(
        {
            "/": xr.Dataset(attrs=attributes),
            "/estimates": fit.estimates,
            "/data": fit.data,
            "/design": xr.Dataset({"design": fit.design, "regressors": fit.regressors}),
        }
    )
    with written_atomically(path) as part:
        write_netcdf(tree, part)


def open_fit(path: str | os.PathLike) -> Fit:
    """Read a fit that `save_fit` wrote.

    Raises
    ------
    ParseError
        A file that is not a fit.
    """
    # The model is stored as text; its reference values are a separate attribute.
    tree = open_tree(path, _CONTENT, _EXPECTED)
    attributes = tree.attrs
    parts = {}
    for name, node in tree.children.items():
        parts[str(name)] = node.to_dataset(inherit=False)
    with decoding_errors(path, _EXPECTED):
        model = RegressionModel.parse(attributes["model"])
        fit = Fit(
            name=str(attributes["name"]),
            model=replace(model, reference=json.loads(attributes["reference"])),
            estimates=parts["estimates"],
            data=parts["data"],
            design=parts["design"]["design"],
            regressors=parts["design"]["regressors"],
        )
        fault = _find_fault(fit)
    if fault:
        raise ParseError(str(path), 0, fault, _EXPECTED)
    return fit


# Sums of squares of larger numbers overflow.
_LARGEST = 1e100
# relative difference of numbers that are stored twice, from the rounding of a root and of a product
_SAME = 1e-6
# dimensions of the figures of a fit that other computations use
_LAYOUT = {
    "estimate": ("term",),
    "stderr": ("term",),
    "covariance": ("term", "term_"),
    "correlation": ("term", "term_"),
    "systematic": ("term", "error"),
}


def _find_fault(fit: Fit) -> str:
    """Return what makes the content of a file useless, an empty text for nothing."""
    estimates = fit.estimates
    terms = [str(term) for term in estimates["term"].values]
    if len({*terms}) < len(terms):
        return "two estimates of one term"
    for name, dims in _LAYOUT.items():
        if name not in estimates:
            return f"estimates without {name}"
        figure = estimates[name]
        if figure.dims != dims or figure.dtype.kind not in "iuf":
            return f"the figure {name} that is not a number for each {' and '.join(dims)}"
        if name != "correlation" and not _is_usable(figure):
            return f"the figure {name} with NaN, infinite or very large numbers"
        if lost := [axis for axis in dims if axis not in estimates.indexes]:
            return f"the figure {name} without the names of its {lost[0]}"
        if twice := [axis for axis in dims if not estimates.indexes[axis].is_unique]:
            return f"the figure {name} with one name for two of its {twice[0]}"
    if [str(term) for term in estimates["term_"].values] != terms:
        return "a covariance of other terms than the estimates"
    return _find_covariance_fault(estimates) or _find_sample_fault(fit, terms)


def _find_covariance_fault(estimates: xr.Dataset) -> str:
    """Return what contradicts a covariance matrix: it is symmetric, and stderr is its diagonal."""
    covariance, stderr = estimates["covariance"].values, estimates["stderr"].values
    variance = np.diag(covariance)
    if np.any(variance < 0.0) or not np.allclose(np.sqrt(variance), stderr, _SAME, 0.0):
        return "the figure covariance whose diagonal is not the square of stderr"
    # |c_ij| <= s_i s_j of any covariance; a changed number far off the diagonal breaks this
    bound = np.outer(stderr, stderr)
    is_symmetric = np.allclose(covariance, covariance.T, _SAME, _SAME * bound.max(initial=0.0))
    if not is_symmetric or np.any(np.abs(covariance) > (1.0 + _SAME) * bound):
        return "the figure covariance that is not a covariance matrix"
    return ""


def _find_sample_fault(fit: Fit, terms: list[str]) -> str:
    """Return what makes the samples of a fit useless."""
    data = fit.data
    if "sample" not in data.sizes:
        return "data without samples"
    for name, figure in (("design", fit.design), ("regressors", fit.regressors)):
        if figure.dims != ("sample", "term") or figure.dtype.kind not in "iuf":
            return f"the figure {name} that is not a number for each sample and term"
        if figure.sizes["sample"] != data.sizes["sample"]:
            return f"the figure {name} with another number of samples than the data"
        if figure.sizes["term"] != len(terms):
            return f"the figure {name} with another number of terms than the estimates"
        if not _is_usable(figure):
            return f"the figure {name} with NaN, infinite or very large numbers"
    # Time and manoeuvre are those of a fit of flights, see `fit_figure`.
    for name in (fit.model.coefficient, *fit.model.variables, "time", "manoeuvre"):
        # values that a publication states come without samples of the coefficient
        if name not in data:
            continue
        if data[name].dims != ("sample",) or data[name].dtype.kind not in "iuf":
            return f"the variable {name} that is not a number for each sample"
        if not _is_usable(data[name]):
            return f"the variable {name} with NaN, infinite or very large numbers"
    return ""


def _is_usable(numbers: xr.DataArray) -> bool:
    return bool(np.all(np.abs(numbers.values) < _LARGEST))


def open_tree(path: str | os.PathLike, content: str, expected: str) -> xr.DataTree:
    """Read a netCDF file whose root attribute ``content`` must be `content`.

    Parameters
    ----------
    path : path
    content : str
    expected : str
        Description of the expected file, for the error message.

    Raises
    ------
    ParseError
        A file of another content, or a file that is not a netCDF file.
    """
    demand_self_contained(path)
    with (
        decoding_errors(path, expected),
        xr.open_datatree(
            path, engine="h5netcdf", phony_dims="access", decode_timedelta=False
        ) as tree,
    ):
        tree.load()
    for node in tree.subtree:
        for key, value in node.attrs.items():
            if isinstance(value, h5py.Empty):
                raise ParseError(str(path), 0, f"an attribute {key} without a value", expected)
    if tree.attrs.get("content") != content:
        raise ParseError(str(path), 0, "a netCDF file of something else", expected)
    return tree
