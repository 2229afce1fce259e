"""Result of a regression: estimates, their errors and the samples, as text and as a file."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from aerodb.store.overview import display_text, plain_number
from flightmech.errors import (
    AeromatchWarning,
    IdentificationError,
    SchemaError,
    UnknownName,
)
from flightmech.names import quantity_attributes
from flightmech.short_text import ShortText
from flightmech.support.figures import html_table
from flighttest.parameter_constraints import describe_constraints
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit_data import FitData
from flighttest.regression.equation_error.fit_remarks import fit_figure, remarks_of
from flighttest.regression.equation_error.model import term_regressors
from flighttest.remarks import Remark, TabledEstimates, remark_lines

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ROUNDING = 1e-9  # margin of a range, of its ends: rounding by the conversion of units
_WHITE = 0.01  # probability of the portmanteau statistic above which a residual counts as white
# columns of a report between interval and end, with their widths
_HEADS = {"white": 10, "system.": 10, "t": 9, "p": 9, "dof": 6, "VIF": 8, "share": 8}


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
