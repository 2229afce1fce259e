"""Result of a regression: estimates, their errors and the samples, as text and as a file."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
import xarray as xr

from aerodb.store.overview import display_text, plain_number
from flightmech.errors import (
    AeromatchWarning,
    IdentificationError,
    ParseError,
    SchemaError,
    UnknownName,
)
from flightmech.names import quantity_attributes
from flightmech.short_text import ShortText
from flightmech.support.array_files.netcdf_writing import write_netcdf
from flightmech.support.atomic_write import written_atomically
from flightmech.support.figures import html_table
from flightmech.support.hdf5_seal import decoding_errors, demand_self_contained
from flighttest.parameter_constraints import describe_constraints
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit_remarks import FitData, fit_figure, remarks_of
from flighttest.regression.equation_error.model import RegressionModel, term_regressors
from flighttest.remarks import Remark, TabledEstimates, remark_lines

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ROUNDING = 1e-9  # margin of a range, of its ends: rounding by the conversion of units
_CONTENT = "aeromatch fit"
_WHITE = 0.01  # probability of the portmanteau statistic above which a residual counts as white
# columns of a report between interval and end, with their widths
_HEADS = {"white": 10, "system.": 10, "t": 9, "p": 9, "dof": 6, "VIF": 8, "share": 8}
_EXPECTED = "a fit as `aeromatch flight identify -o` writes it"


def predict_samples(fit: FitData, data: xr.Dataset, manoeuvre: int | None) -> xr.Dataset:
    """Return coefficient and standard error at the samples of `data`; see `Fit.predict`."""
    samples = _read_samples(fit, data)
    X = _regressors_at(fit, samples, manoeuvre)
    e = fit.estimates
    # x'(C + D D')x of every sample, with the covariance C and the systematic changes D
    variance = np.einsum("ij,jk,ik->i", X, e["covariance"].values, X)
    variance = variance + ((X @ e["systematic"].values) ** 2).sum(axis=1)
    outside = describe_extrapolation(fit, samples, X)
    if outside:
        warnings.warn(
            f"{_title(fit)} is used outside the fitted range: {'; '.join(outside)}",
            AeromatchWarning,
            stacklevel=3,
        )
    (dim,) = samples.sizes
    coefficient = fit.model.coefficient
    predicted = X @ e["estimate"].values
    columns = {
        coefficient: (dim, predicted, quantity_attributes(coefficient)),
        "stderr": (
            dim,
            np.sqrt(variance),
            {"long_name": "standard error of the fitted coefficient"},
        ),
    }
    return xr.Dataset(columns, samples.coords)


def describe_extrapolation(fit: FitData, samples: xr.Dataset, X: np.ndarray) -> list[str]:
    """Return texts of the variables and terms that exceed the range of the fitted samples.

    Parameters
    ----------
    fit : FitData
    samples : Dataset (sample,)
        Variables of the model.
    X : array (sample, term)
        Regressors of the estimates there.
    """
    variables = fit.model.variables
    texts = []
    for name in variables:
        fitted = fit.data[name].values
        texts.append(_describe_excess(name, samples[name].values, fitted, _variable_text(name)))
    for term, x, fitted in zip(fit.estimates["term"].values, X.T, fit.regressors.values.T):
        if str(term) not in variables and not least_squares.intercept_mask([str(term)])[0]:
            texts.append(_describe_excess(str(term), x, fitted, plain_number))
    return [text for text in texts if text]


def _variable_text(name: str) -> Callable[[float], str]:
    """Return the function that writes a value of a variable with its unit."""
    return lambda value: display_text(name, value)


def _describe_excess(
    name: str, x: np.ndarray, fitted: np.ndarray, to_text: Callable[[float], str]
) -> str:
    """Return the text of one variable or term; empty if its samples are inside the range."""
    x, low, high = x[np.isfinite(x)], float(fitted.min()), float(fitted.max())
    # Values beyond the range by the rounding of a unit conversion are inside.
    margin = _ROUNDING * max(abs(low), abs(high))
    outside = (x < low - margin) | (x > high + margin)
    if not outside.any():
        return ""
    used_range = f"{to_text(float(x.min()))} ... {to_text(float(x.max()))}"
    fitted_range = f"{to_text(low)} ... {to_text(high)}"
    return (
        f"{name} is {used_range}, fitted over {fitted_range} "
        f"({int(outside.sum())} of {len(x)} samples outside)"
    )


def _regressors_at(fit: FitData, samples: xr.Dataset, manoeuvre: int | None) -> np.ndarray:
    """Return the regressors of the estimates (sample, term), with the constant of `manoeuvre`."""
    terms = [str(term) for term in fit.estimates["term"].values]
    separate = [term for term in terms if term.startswith("1[")]
    if manoeuvre is None and separate:
        raise IdentificationError(
            f"{fit.model} has a constant for each manoeuvre, {', '.join(separate)}; choose "
            f"one with manoeuvre="
        )
    if manoeuvre is not None and f"1[{manoeuvre}]" not in separate:
        raise UnknownName(
            f"1[{manoeuvre}]",
            separate,
            "intercept",
            f"manoeuvre={manoeuvre} has no separate constant in this fit",
        )
    # Of separate constants, that of the manoeuvre is one, and the others are zero.
    names, is_off = list(terms), np.zeros(len(terms), bool)
    for j, term in enumerate(terms):
        if term in separate:
            names[j] = "1"
            is_off[j] = term != f"1[{manoeuvre}]"
    rows = term_regressors(names, samples, fit.model.reference)
    return np.where(is_off, 0.0, rows.T)


def _read_samples(fit: FitData, data: xr.Dataset) -> xr.Dataset:
    """Return the model variables along their one dimension; other variables are ignored."""
    names = list(fit.model.variables)
    for name in names:
        if name not in data:
            raise UnknownName(
                name,
                map(str, data.data_vars),
                "model variable",
                f"the data do not hold it; {fit.model} needs it",
            )
    dim, size = _common_dimension(fit, data)
    columns = {}
    for name in names:
        columns[name] = dim, np.broadcast_to(data[name].values.astype(float), (size,))
    coordinate: Any = np.arange(size)
    if dim in data.coords:
        coordinate = data[dim]
    return xr.Dataset(columns, {dim: coordinate})


def _common_dimension(fit: FitData, data: xr.Dataset) -> tuple[str, int]:
    """Return the dimension of the model variables and its size; scalars have that of the data."""
    sizes = {str(dim): size for dim, size in data[list(fit.model.variables)].sizes.items()}
    if len(sizes) > 1:
        raise SchemaError(
            "data",
            [
                f"the variables of {fit.model} have the dimensions "
                f"{', '.join(map(str, sizes))}; one is allowed"
            ],
        )
    if sizes:
        return next(iter(sizes.items()))
    for dim in ("time", "sample"):
        if dim in data.sizes:
            return dim, data.sizes[dim]
    return "sample", 1


@dataclass(frozen=True)
class Fit(FitData, ShortText, TabledEstimates):
    """Estimates of one model from one or several manoeuvres, with remarks and predictions.

    The attributes are those of `FitData`.
    """

    def predict(self, data: xr.Dataset, manoeuvre: int | None = None) -> xr.Dataset:
        """Return the prediction of the fit for other data.

        Parameters
        ----------
        data : Dataset (time,) or (sample,)
            Contains the variables of the model; scalars are allowed. [SI]
        manoeuvre : int, optional
            Number of the manoeuvre, from 0, whose constant a fit with ``intercepts="separate"``
            uses.

        Returns
        -------
        Dataset (time,) or (sample,)
            The coefficient, and ``stderr`` of its mean, sqrt(x'(C + D D')x) with the covariance C
            and the systematic changes D of the estimates. The scatter about the mean,
            ``residual_rms``, is not part of it.

        Raises
        ------
        UnknownName
            A variable that `data` does not hold, or a manoeuvre without a separate constant.
        IdentificationError
            A fit with separate intercepts, and no manoeuvre chosen.
        SchemaError
            Variables along more than one dimension.

        Warns
        -----
        AeromatchWarning
            A variable, or a further term such as a product or a power, exceeds the range of the
            fitted samples.

        Notes
        -----
        The ranges are those of single variables and terms. Data may be inside all of them and still
        far from all fitted samples, as at high alpha with an elevator that trims at low alpha.
        ``stderr`` is large there.
        """
        return predict_samples(self, data, manoeuvre)

    @property
    def remarks(self) -> list[Remark]:
        """Remarks on the validity of the estimates; errors first."""
        return remarks_of(self)

    def plot(self) -> Figure:
        """Return a figure of the measured and the fitted coefficient, and of the residual.

        Raises
        ------
        AeromatchError
            matplotlib is not installed.
        IdentificationError
            Published values, which have no samples.
        """
        return fit_figure(self)

    def _repr_html_(self) -> str:
        """Return the estimates as a table for a notebook."""
        names = []
        for name in ("estimate", "stderr", "stderr_systematic", "contribution"):
            if name in self.estimates:
                names.append(name)
        rows = []
        for term in self.estimates["term"].values:
            row = self.estimates.sel(term=term)
            rows.append((str(term), *(float(row[name]) for name in names)))
        notes = [_describe_quality(self.estimates.attrs), *remark_lines(self.remarks)]
        return html_table(_title(self), ("term", *names), rows, notes)

    def report(self, correlation: bool = False) -> str:
        """Return estimates with 95 % confidence intervals, tests and remarks as text.

        Parameters
        ----------
        correlation : bool
            Add the correlation matrix of the estimates.
        """
        e, a = self.estimates, self.estimates.attrs
        width = max(18, *(len(str(term)) + 2 for term in e["term"].values))
        heads = "".join(f"{head:>{head_width}}" for head, head_width in _HEADS.items())
        lines = [
            _title(self),
            _describe_quality(a),
            *slope_test_lines(a),
            *constraint_lines(a),
            f"{'term':<{width}}{'estimate':>11}{'stderr':>10}{'95 % interval':>24}{heads}",
        ]
        for k, term in enumerate(e["term"].values):
            lines.append(f"{term!s:<{width}}{_term_line(e, k)}")
        if correlation:
            lines += correlation_lines(e)
        return "\n".join([*lines, *remark_lines(self.remarks)])


def _title(fit: FitData) -> str:
    if not fit.name:
        return str(fit.model)
    return f"{fit.name}: {fit.model}"


def _term_line(e: xr.Dataset, k: int) -> str:
    """Return the figures of one term; figures that the fit does not have are NaN."""

    def figure(name: str) -> float:
        if name not in e:
            return float("nan")
        return float(e[name][k])

    interval = f"{figure('low'):.4g} ... {figure('high'):.4g}"
    # A constant has no variance inflation.
    vif = "-"
    if not np.isnan(figure("vif")):
        vif = f"{figure('vif'):.1f}"
    return (
        f"{figure('estimate'):>11.5g}{figure('stderr'):>10.2g}{interval:>24}"
        f"{figure('stderr_white'):>10.2g}{figure('stderr_systematic'):>10.2g}"
        f"{figure('t'):>9.1f}{figure('p_value'):>9.1g}{figure('dof'):>6.0f}{vif:>8}"
        f"{figure('contribution'):>8.2f}"
    )


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
        xr.open_datatree(path, engine="h5netcdf", decode_timedelta=False) as tree,
    ):
        tree.load()
    for node in tree.subtree:
        for key, value in node.attrs.items():
            if isinstance(value, h5py.Empty):
                raise ParseError(str(path), 0, f"an attribute {key} without a value", expected)
    if tree.attrs.get("content") != content:
        raise ParseError(str(path), 0, "a netCDF file of something else", expected)
    return tree


def _describe_quality(a: Mapping[str, Any]) -> str:
    """Return samples, R2 and options of a fit as text, from the attributes of its estimates."""
    if a.get("domain") == "published":
        return "published values, no samples"
    # Options appear only if they differ from their defaults.
    text = (
        f"samples {a['samples']}, manoeuvres {a['manoeuvres']}, R2 {a['R2']:.4f}, residual "
        f"rms {a['residual_rms']:.3g}"
    )
    if a.get("domain") == "frequency":
        text += f", {a['frequencies']} frequencies in {a['band']} Hz"
    if a.get("method"):
        text += f", {a['method']}"
    if a.get("weights", "equal") != "equal":
        text += f", weights {a['weights']}"
    if a.get("ridge"):
        text += f", ridge {a['ridge']:.3g} (biased)"
    return text


def slope_test_lines(a: Mapping[str, Any]) -> list[str]:
    """Return the test of all slopes and the colour of the residual, as text.

    Parameters
    ----------
    a : mapping
        Attributes of the estimates.
    """
    lines = []
    if a.get("F_terms"):
        lines.append(
            f"all slopes: F({a['F_terms']}, {a['F_dof']:.0f}) {a['F']:.4g}, probability "
            f"{a['F_probability']:.2g}"
        )
    if "portmanteau" in a:
        colour = "white" if a["portmanteau_probability"] > _WHITE else "not white"
        lines.append(
            f"residual: {colour}, portmanteau {a['portmanteau']:.4g} over "
            f"{a['portmanteau_lags']} lags, probability "
            f"{a['portmanteau_probability']:.2g}, correlation time {a['correlation_time']:.2g} s"
        )
    return lines


def constraint_lines(a: Mapping[str, Any]) -> list[str]:
    """Return the constraints and the noise of the regressors, as text.

    Parameters
    ----------
    a : mapping
        Attributes of the estimates.
    """
    lines = describe_constraints(a.get("constraints", ""))
    if "noise_treatment" in a:
        lines.append(str(a["noise_treatment"]))
    return lines


def correlation_lines(e: xr.Dataset) -> list[str]:
    """Return the correlation matrix of estimates as lines of text."""
    terms = [str(term) for term in e["term"].values]
    # Columns for a correlation and for the longest name.
    width = max(9, *[len(term) + 2 for term in terms])
    lines = [f"{'correlation':<18}" + "".join(f"{term:>{width}}" for term in terms)]
    for term, row in zip(terms, e["correlation"].values):
        line = f"{term:<18}"
        for correlation in row:
            line += f"{correlation:>{width}.3f}"
        lines.append(line)
    return lines
