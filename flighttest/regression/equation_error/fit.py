"""What a regression found: estimates, their errors, the samples behind them; as text and as a file."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
from flightmech.support.atomic_write import written_atomically
from flightmech.support.figures import html_table
from flightmech.support.hdf5_seal import demand_self_contained
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit_remarks import FitData, fit_figure, remarks_of
from flighttest.regression.equation_error.model import RegressionModel, term_regressors
from flighttest.remarks import Remark, remark_lines

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ROUNDING = 1e-9  # of the ends of a range: what the conversion of units may add


def predict_samples(fit: FitData, data: xr.Dataset, manoeuvre: int | None) -> xr.Dataset:
    """Return coefficient and standard error at the samples of `data`; see `Fit.predict`."""
    samples = _samples(fit, data)
    X = _design(fit, samples, manoeuvre)
    e = fit.estimates
    variance = np.einsum("ij,jk,ik->i", X, e["covariance"].values, X) + (
        (X @ e["systematic"].values) ** 2
    ).sum(axis=1)
    found = describe_extrapolation(fit, samples, X)
    if found:
        name = f"{fit.name}: " if fit.name else ""
        warnings.warn(
            f"{name}{fit.model} is used outside the fitted range: {'; '.join(found)}",
            AeromatchWarning,
            stacklevel=3,
        )
    (dim,) = samples.sizes
    columns = {
        fit.model.coefficient: (
            dim,
            X @ e["estimate"].values,
            quantity_attributes(fit.model.coefficient),
        ),
        "stderr": (
            dim,
            np.sqrt(variance),
            {"long_name": "standard error of the fitted coefficient"},
        ),
    }
    return xr.Dataset(columns, samples.coords)


def describe_extrapolation(fit: FitData, samples: xr.Dataset, X: np.ndarray) -> list[str]:
    """Return in words which variables and which further terms leave the range of the samples that
    were fitted.

    Parameters
    ----------
    fit : FitData
    samples : Dataset (sample,)
        Variables of the model.
    X : array (sample, term)
        Regressors of the estimates there.
    """
    variables = fit.model.variables
    found = [
        _beyond(name, samples[name].values, fit.data[name].values, partial(display_text, name))
        for name in variables
    ]
    for term, x, known in zip(fit.estimates["term"].values, X.T, fit.regressors.values.T):
        if str(term) not in variables and not least_squares.intercept_mask([str(term)])[0]:
            found.append(_beyond(str(term), x, known, plain_number))
    return [text for text in found if text]


def _beyond(name: str, x: np.ndarray, known: np.ndarray, words: Callable[[float], str]) -> str:
    x, low, high = x[np.isfinite(x)], float(known.min()), float(known.max())
    margin = _ROUNDING * max(abs(low), abs(high))
    out = (x < low - margin) | (x > high + margin)
    if not out.any():
        return ""
    span, fitted = (
        f"{words(a)} ... {words(b)}" for a, b in ((float(x.min()), float(x.max())), (low, high))
    )
    return f"{name} is {span}, fitted over {fitted} ({int(out.sum())} of {len(x)} samples outside)"


def _design(fit: FitData, samples: xr.Dataset, manoeuvre: int | None) -> np.ndarray:
    """Return the regressors of the estimates (sample, term): of separate intercepts, that of
    `manoeuvre` is one, the others zero.
    """
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
            f"manoeuvre={manoeuvre} is none of those with a constant of their own",
        )
    rows = term_regressors(
        ["1" if term in separate else term for term in terms], samples, fit.model.reference
    )
    away = [term in separate and term != f"1[{manoeuvre}]" for term in terms]
    return np.where(away, 0.0, rows.T)


def _samples(fit: FitData, data: xr.Dataset) -> xr.Dataset:
    """Return the variables of the model along the one dimension that they have; other variables may
    have dimensions of their own.
    """
    for name in fit.model.variables:
        if name not in data:
            raise UnknownName(
                name,
                map(str, data.data_vars),
                "model variable",
                f"the data do not hold it; {fit.model} needs it",
            )
    own = data[list(fit.model.variables)]
    sizes = (
        dict(own.sizes)
        or {dim: data.sizes[dim] for dim in ("time", "sample") if dim in data.sizes}
        or {"sample": 1}
    )
    if len(sizes) > 1:
        raise SchemaError(
            "data",
            [
                f"the variables of {fit.model} have the dimensions "
                f"{', '.join(map(str, sizes))}; one is allowed"
            ],
        )
    ((dim, size),) = sizes.items()
    columns = {
        name: (dim, np.broadcast_to(own[name].values.astype(float), (size,)))
        for name in fit.model.variables
    }
    return xr.Dataset(columns, {dim: data[dim] if dim in data.coords else np.arange(size)})


_CONTENT = "aeromatch fit"


@dataclass(frozen=True)
class Fit(FitData):
    """Estimates of one model from one or several manoeuvres: `FitData` with remarks, text and
    predictions.
    """

    def predict(self, data: xr.Dataset, manoeuvre: int | None = None) -> xr.Dataset:
        """Return what the fit predicts of other data.

        Parameters
        ----------
        data : Dataset (time,) or (sample,)
            Holds the variables of the model; scalars are allowed. [SI]
        manoeuvre : int, optional
            Of a fit with ``intercepts="separate"``: which manoeuvre's constant is meant, from 0.

        Returns
        -------
        Dataset (time,) or (sample,)
            The coefficient, and ``stderr`` of its mean, sqrt(x'(C + D D')x) with the covariance C
            and the systematic changes D of the estimates; what scatters about the mean,
            ``residual_rms``, is not in it.

        Raises
        ------
        UnknownName
            A variable that `data` does not hold, or a manoeuvre without a constant of its own.
        IdentificationError
            A fit with separate intercepts, and no manoeuvre chosen.
        SchemaError
            Variables along more than one dimension.

        Warns
        -----
        AeromatchWarning
            A variable, or a further term such as a product or a power, leaves the range of the
            samples that were fitted.

        Notes
        -----
        Ranges are those of one variable or term at a time.  Data may lie inside all of them and still where no sample was, as at high
        alpha with an elevator that trims at low alpha; `stderr` grows there.
        """
        return predict_samples(self, data, manoeuvre)

    @property
    def remarks(self) -> list[Remark]:
        """What a reader of the numbers must know."""
        return remarks_of(self)

    def plot(self) -> Figure:
        """Return a figure: the measured coefficient, the fitted one and the residual over the
        samples.

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
        columns = ("estimate", "stderr", "stderr_systematic", "contribution")
        given = [name for name in columns if name in self.estimates]
        rows = [
            (str(term), *(float(self.estimates[name].sel(term=term)) for name in given))
            for term in self.estimates["term"].values
        ]
        caption = f"{self.name}: {self.model}" if self.name else str(self.model)
        return html_table(
            caption,
            ("term", *given),
            rows,
            [_headline(self.estimates.attrs), *remark_lines(self.remarks)],
        )

    def report(self, correlation: bool = False) -> str:
        """Return estimates with 95 % confidence intervals, tests and remarks as text.

        Parameters
        ----------
        correlation : bool
            Print the correlation matrix of the estimates too.
        """
        return _report(self, correlation)


def save_fit(fit: Fit, path: str | os.PathLike) -> None:
    """Write a fit to a netCDF-4 file, atomically.

    Parameters
    ----------
    fit : Fit
    path : path
        An older file is replaced.
    """
    path = Path(path)
    about = {
        "content": _CONTENT,
        "name": fit.name,
        "model": str(fit.model),
        "reference": json.dumps(dict(fit.model.reference)),
    }
    tree = xr.DataTree.from_dict(
        {
            "/": xr.Dataset(attrs=about),
            "/estimates": fit.estimates,
            "/data": fit.data,
            "/design": xr.Dataset({"design": fit.design, "regressors": fit.regressors}),
        }
    )
    with written_atomically(path) as part:
        tree.to_netcdf(part, engine="h5netcdf", mode="w")


def open_fit(path: str | os.PathLike) -> Fit:
    """Read a fit that `save_fit` wrote.

    Raises
    ------
    ParseError
        Not such a file.
    """
    tree = open_tree(path, _CONTENT, "a fit as `aeromatch flight identify -o` writes it")
    about, parts = (
        tree.attrs,
        {str(name): node.to_dataset(inherit=False) for name, node in tree.children.items()},
    )
    model = replace(RegressionModel.parse(about["model"]), reference=json.loads(about["reference"]))
    return Fit(
        str(about["name"]),
        model,
        parts["estimates"],
        parts["data"],
        parts["design"]["design"],
        parts["design"]["regressors"],
    )


def open_tree(path: str | os.PathLike, content: str, expected: str) -> xr.DataTree:
    """Read a netCDF file whose root attribute ``content`` must be `content`.

    Raises
    ------
    ParseError
        Not such a file; the text ends with what was `expected`.
    """
    demand_self_contained(path)
    try:
        with xr.open_datatree(path, engine="h5netcdf", decode_timedelta=False) as tree:
            tree.load()
    except (OSError, KeyError, ValueError) as error:
        if not Path(path).exists():
            raise
        raise ParseError(str(path), 0, str(error), expected) from error
    if tree.attrs.get("content") != content:
        raise ParseError(str(path), 0, "a netCDF file of something else", expected)
    return tree


def _headline(a) -> str:
    """How the fit was made, in words."""
    if a.get("domain") == "published":
        return "published values, no samples"
    words = (
        f"samples {a['samples']}, manoeuvres {a['manoeuvres']}, R2 {a['R2']:.4f}, residual "
        f"rms {a['residual_rms']:.3g}"
    )
    if a.get("domain") == "frequency":
        words += f", {a['frequencies']} frequencies in {a['band']} Hz"
    if a.get("weights", "equal") != "equal":
        words += f", weights {a['weights']}"
    if a.get("ridge"):
        words += f", ridge {a['ridge']:.3g} (biased)"
    return words


def slope_test_lines(a: Mapping[str, Any]) -> list[str]:
    """Return the test of all slopes and the colour of the residual, in words.

    Parameters
    ----------
    a : mapping
        Attributes of the estimates.
    """
    found = []
    if a.get("F_terms"):
        found.append(
            f"all slopes: F({a['F_terms']}, {a['F_dof']:.0f}) {a['F']:.4g}, probability "
            f"{a['F_probability']:.2g}"
        )
    if "portmanteau" in a:
        white = "white" if a["portmanteau_probability"] > 0.01 else "not white"
        found.append(
            f"residual: {white}, portmanteau {a['portmanteau']:.4g} over "
            f"{a['portmanteau_lags']} lags, probability "
            f"{a['portmanteau_probability']:.2g}, correlation time {a['correlation_time']:.2g} s"
        )
    return found


def correlation_lines(e: xr.Dataset) -> list[str]:
    """Return the correlation matrix of estimates as lines of text."""
    terms = [str(term) for term in e["term"].values]
    width = max(9, *(len(term) + 2 for term in terms))
    head = f"{'correlation':<18}" + "".join(f"{term:>{width}}" for term in terms)
    return [
        head,
        *(
            f"{term:<18}" + "".join(f"{x:>{width}.3f}" for x in row)
            for term, row in zip(terms, e["correlation"].values)
        ),
    ]


_HEADS = {"white": 10, "system.": 10, "t": 9, "p": 9, "dof": 6, "VIF": 8, "share": 8}


def _report(fit: Fit, correlation: bool) -> str:
    e, a = fit.estimates, fit.estimates.attrs
    wide = max(18, *(len(str(term)) + 2 for term in e["term"].values))
    text = [
        f"{fit.name}: {fit.model}" if fit.name else str(fit.model),
        _headline(a),
        *slope_test_lines(a),
        f"{'term':<{wide}}{'estimate':>11}{'stderr':>10}{'95 % interval':>24}"
        + "".join(f"{head:>{width}}" for head, width in _HEADS.items()),
    ]
    for term in e["term"].values:
        found = {
            str(name): float(e[name].sel(term=term))
            for name, item in e.data_vars.items()
            if item.dims == ("term",)
        }
        row = {name: float("nan") for name in ("low", "high", "t", "p_value", "dof")} | found
        vif = "-" if np.isnan(row["vif"]) else f"{row['vif']:.1f}"
        errors = "".join(f"{row[name]:>10.2g}" for name in ("stderr_white", "stderr_systematic"))
        between = f"{row['low']:.4g} ... {row['high']:.4g}"
        t = f"{row['t']:>9.1f}{row['p_value']:>9.1g}{row['dof']:>6.0f}"
        text.append(
            f"{term!s:<{wide}}{row['estimate']:>11.5g}{row['stderr']:>10.2g}{between:>24}{errors}{t}{vif:>8}{row['contribution']:>8.2f}"
        )
    return "\n".join(
        [*text, *(correlation_lines(e) if correlation else []), *remark_lines(fit.remarks)]
    )
