"""Result of a likelihood fit: estimates, errors, residuals, noise and remarks."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flightmech.support.array_files.netcdf_writing import write_netcdf
from flightmech.support.atomic_write import written_atomically
from flightmech.support.console import to_json_types
from flighttest.maximum_likelihood.innovations import whiteness_remarks
from flighttest.maximum_likelihood.likelihood import CONVERGED, STALLED, LikelihoodMaximum
from flighttest.maximum_likelihood.residual_covariance import ResidualNoise, innovation_coupling
from flighttest.maximum_likelihood.search import ROUNDED, invert_information
from flighttest.maximum_likelihood.unknowns import UnknownVector
from flighttest.parameter_constraints import (
    constraint_remarks,
    constraints_to_json,
    describe_constraints,
)
from flighttest.regression.equation_error.fit_file import open_tree
from flighttest.remarks import PrintedResult, Remark, TabledEstimates, remarks_to_json

HIGH = 0.9  # correlation that is reported
_COUPLED = 1.0 - 1e-9  # correlation of two parameters that a constraint makes proportional
# standard error over the a-priori one, above which a record contains hardly any information
SILENT = 0.9
# attribute of estimates that did not converge: which disturbance suffices
UNDETERMINED = "undetermined"
# attribute of estimates of output error in place of filter error: why no disturbance is needed
CALM = "calm"
_CONTENT = "output error"
# the test of innovations
_WHITENESS = ("portmanteau", "portmanteau_lags", "portmanteau_probability", "outside")
_DISTURBED = ("process.", "gust.", "init.gust_")  # unknowns of a model with a disturbance
_PRINTED = "portmanteau_probability"
# columns of a report: heading, variable, format
_COLUMNS = (
    ("estimate", "estimate", ".6g"),
    ("std. error", "stderr", ".3g"),
    ("if white", "stderr_white", ".3g"),
    ("start", "start", ".6g"),
    ("prior s.e.", "prior_stderr", ".3g"),
)


@dataclass(frozen=True)
class OutputError(PrintedResult, TabledEstimates):
    """Maximum-likelihood estimates from full responses.

    Attributes
    ----------
    estimates : Dataset (parameter, parameter_)
        ``estimate``, ``stderr`` (coloured residuals, never below the next),
        ``stderr_white`` (Cramer-Rao bound), ``covariance`` and ``correlation`` (coloured),
        ``information`` (Fisher, prior included), ``start``, ``prior_stderr``, ``low``, ``high`` and
        ``active``: at a bound, without a standard error. Attributes: ``method``, ``cost``,
        ``iterations``, ``converged``, ``stop`` (why the search ended: ``converged``, ``stalled``
        or ``iterations``), ``remaining_step`` (in standard errors), ``samples``, ``manoeuvres``.
    residuals : tuple of Dataset
        Per manoeuvre measured minus predicted outputs over ``time``, or over ``frequency`` as
        complex numbers.
    noise : Dataset
        ``stderr`` (manoeuvre, output) of the noise; ``covariance`` (output, output_) of the
        residuals of all manoeuvres. In time also, per output, ``slow`` and ``fast``, its
        disturbance and its noise from sample to sample, ``time``, correlation time of the
        disturbance [s], ``block``, the blocks in which it was estimated [s], and ``motion``, rms of
        the measured output about its mean; ``coupling`` (output, output_), above one for two
        coupled disturbances. The attribute ``effect`` is the share of the motion by which the error
        of an estimate moves the outputs. Of filter error also the test of the innovations, as from
        `whiteness_variables`.
    warnings : tuple of str
        Reasons not to trust the standard errors or the estimates.
    """

    estimates: xr.Dataset
    residuals: tuple[xr.Dataset, ...]
    noise: xr.Dataset
    warnings: tuple[str, ...] = ()

    @property
    def parameters(self) -> dict[str, float]:
        """The estimates by name, for a simulation, without those of single manoeuvres."""
        common = {}
        for name, value in self._values().items():
            if "@" not in name:
                common[name] = value
        return common

    def _values(self) -> dict[str, float]:
        """Return all estimates by name."""
        e = self.estimates
        return dict(zip(map(str, e["parameter"].values), map(float, e["estimate"].values)))

    def of_manoeuvre(self, number: int) -> dict[str, float]:
        """Return the estimates of one manoeuvre: the common ones and its separate ones.

        Parameters
        ----------
        number : int
            Number of the manoeuvre, from 1.

        Raises
        ------
        IndexError
            A number without manoeuvre.
        """
        if not 1 <= number <= len(self.residuals):
            raise IndexError(f"manoeuvre {number}; there are 1 to {len(self.residuals)}")
        values = self.parameters
        for name, value in self._values().items():
            if name.endswith(f"@{number}"):
                values[name.removesuffix(f"@{number}")] = value
        return values

    @property
    def remarks(self) -> list[Remark]:
        """Remarks on the validity of the estimates."""
        return _list_remarks(self)

    def report_lines(self) -> list[str]:
        """Return estimates and noise as lines."""
        return _report_lines(self)

    def as_dict(self) -> dict[str, Any]:
        """Return estimates, noise, covariance and remarks as JSON types."""
        return to_json_types(
            {
                **constraints_to_json(self.estimates.attrs),
                "parameters": _list_columns(self.estimates, "parameter"),
                "noise": _noise_by_output(self.noise),
                "whiteness": _list_columns(self.noise, "output", _WHITENESS),
                "covariance": self.estimates["covariance"].values,
                "remarks": remarks_to_json(self.remarks),
            }
        )


def _list_columns(
    table: xr.Dataset, dim: str, names: Sequence[str] | None = None
) -> dict[str, dict[str, float]]:
    """Return the variables of one dimension as a mapping of row to column to value."""
    columns = [str(name) for name, x in table.data_vars.items() if x.dims == (dim,)]
    if names is not None:
        columns = [name for name in columns if name in names]
    if not columns:
        return {}
    rows = {}
    for k, row in enumerate(table[dim].values):
        rows[str(row)] = {name: table[name].values[k] for name in columns}
    return rows


def _noise_by_output(noise: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the noise of each output, in every manoeuvre."""
    return {str(name): noise["stderr"].sel(output=name).values for name in noise["output"].values}


def estimates_dataset(
    maximum: LikelihoodMaximum,
    layout: UnknownVector,
    covariance: np.ndarray,
    about: dict[str, str | float | int],
) -> xr.Dataset:
    """Return the estimates Dataset of a `LikelihoodMaximum`.

    Parameters
    ----------
    maximum : LikelihoodMaximum
    layout : UnknownVector
    covariance : array (unknown, unknown)
        Covariance for coloured residuals.
    about : dict
        Further attributes.
    """
    free = ~maximum.active
    readings = 0
    for v in maximum.residuals:
        readings += int(np.isfinite(v).sum())
    # The Cramer-Rao bound M^-1, with the degrees of freedom of the estimated noise.
    white = invert_information(maximum.information, free) * readings / max(1, readings - len(free))
    # A coloured standard error below the white one is a chance result and is raised to it.
    coloured = np.where(np.diag(covariance) > 0.0, np.diag(covariance), np.inf)
    factor = np.sqrt(np.maximum(1.0, np.diag(white) / coloured))
    covariance = covariance * np.outer(factor, factor)
    stderr = np.where(free, np.sqrt(np.diag(covariance)), np.nan)
    # The search knows the errors of white noise only. Those of coloured residuals are larger, and
    # against them what a stalled search has left undone may be nothing.
    shares = np.abs(maximum.remaining) / np.where(stderr > 0.0, stderr, np.inf)
    remaining, stop = float(np.max(shares, initial=0.0)), maximum.stop
    if stop == STALLED and remaining < ROUNDED:
        stop = CONVERGED
    # A parameter without standard error has the correlation zero, and one with itself.
    size = np.where(np.isfinite(stderr) & (stderr > 0.0), stderr, np.inf)
    correlation = covariance / np.outer(size, size) + np.diag(np.where(np.isfinite(size), 0.0, 1.0))
    square = ("parameter", "parameter_")
    variables = {
        "estimate": ("parameter", maximum.theta),
        "stderr": ("parameter", stderr),
        "stderr_white": ("parameter", np.where(free, np.sqrt(np.diag(white)), np.nan)),
        "start": ("parameter", layout.start),
        "prior_stderr": ("parameter", layout.sigma),
        "low": ("parameter", layout.low),
        "high": ("parameter", layout.high),
        "active": ("parameter", maximum.active.astype(np.int8)),
        "covariance": (square, covariance),
        "correlation": (square, correlation),
        "information": (square, maximum.information),
    }
    attributes = {
        **about,
        "cost": maximum.cost,
        "iterations": maximum.iterations,
        "converged": int(stop == CONVERGED),
        "stop": stop,
        "remaining_step": remaining,
        "samples": sum(len(v) for v in maximum.residuals),
        "manoeuvres": len(maximum.residuals),
    }
    names = list(layout.names)
    return xr.Dataset(variables, {"parameter": names, "parameter_": names}, attributes)


def noise_dataset(
    maximum: LikelihoodMaximum,
    outputs: list[str],
    colours: Sequence[ResidualNoise] = (),
    measured: Sequence[np.ndarray] = (),
    effect: float = 0.0,
) -> xr.Dataset:
    """Return the noise Dataset of a `LikelihoodMaximum`.

    Parameters
    ----------
    maximum : LikelihoodMaximum
    outputs : list of str
    colours : sequence of ResidualNoise, optional
        Per output, of residuals in time. They need `measured` and `effect`.
    measured : sequence of array (time, output)
        Outputs of each manoeuvre.
    effect : float
        As from `effect_on_motion`.
    """
    v = np.concatenate(maximum.residuals)
    # A residual of zero is a missing reading: each pair of outputs has its own count.
    count = np.maximum((v != 0.0).T.astype(float) @ (v != 0.0), 1.0)
    variables: dict[str, Any] = {
        "stderr": (("manoeuvre", "output"), np.sqrt(maximum.noise)),
        "covariance": (("output", "output_"), v.T @ v / count),
    }
    coordinates = {
        "output": outputs,
        "output_": outputs,
        "manoeuvre": np.arange(1, len(maximum.residuals) + 1),
    }
    if not colours:
        return xr.Dataset(variables, coordinates)
    # The colours are those of residuals over the root of the noise variance.
    size = np.sqrt(maximum.noise.mean(axis=0))
    slow = np.array([colour.slow for colour in colours])
    fast = np.array([colour.white for colour in colours])
    centred = np.concatenate([z - np.nanmean(z, axis=0) for z in measured])
    innovations = np.column_stack([colour.innovations for colour in colours])
    variables |= {
        "slow": ("output", slow * size),
        "fast": ("output", fast * size),
        "time": ("output", [colour.time for colour in colours]),
        "block": ("output", [colour.block for colour in colours]),
        "motion": ("output", np.sqrt(np.nanmean(centred**2, axis=0))),
        "coupling": (("output", "output_"), innovation_coupling(innovations, colours[0].block)),
    }
    return xr.Dataset(variables, coordinates, {"effect": effect})


def _list_remarks(fit: OutputError) -> list[Remark]:
    """Return warnings, missing convergence, bounds, missing information and correlations."""
    e = fit.estimates
    names = [str(name) for name in e["parameter"].values]
    remarks = [Remark("disturbance", text) for text in fit.warnings]
    if not e.attrs["converged"]:
        text, severity = f"not converged after {e.attrs['iterations']} iterations", "error"
        if e.attrs.get("stop") == STALLED:
            share = e.attrs["remaining_step"]
            text = (
                f"stalled after {e.attrs['iterations']} iterations: no step lowers the cost, "
                f"although its slope calls for a step of {share:.2g} standard errors; start from "
                f"other values"
            )
            # Below one standard error a kink of the model does less than the noise.
            severity = "warning" if share < 1.0 else "error"
        if UNDETERMINED in e.attrs:
            text, severity = str(e.attrs[UNDETERMINED]), "error"
        remarks.append(Remark("convergence", text, severity=severity))
    if CALM in e.attrs:
        remarks.append(Remark("disturbance", str(e.attrs[CALM]), severity="note"))
    if _PRINTED in fit.noise:
        is_filtered = any(name.startswith(_DISTURBED) for name in names)
        remarks += whiteness_remarks(fit.noise, is_filtered)
    for name, is_active, value in zip(names, e["active"].values, e["estimate"].values):
        if is_active:
            text = (
                f"{name} is at its bound {value:g}: it has no standard error, and those of "
                f"the others hold it there"
            )
            remarks.append(Remark("bound", text, name, float(value), float(value)))
    for name, stderr, prior in zip(names, e["stderr"].values, e["prior_stderr"].values):
        if stderr > SILENT * prior:
            text = (
                f"{name}: the records contain hardly any information, standard error "
                f"{stderr:.3g} after {prior:.3g} before"
            )
            limit = SILENT * float(prior)
            remarks.append(Remark("not significant", text, name, float(stderr), limit))
    remarks += constraint_remarks(e.attrs.get("constraints", ""))
    # Pairs below the diagonal, each once. Those that a constraint couples are expected.
    rho = e["correlation"].values
    for i, j in zip(*np.nonzero(np.tril(np.abs(rho) > HIGH, -1))):
        if "constraints" in e.attrs and abs(rho[i, j]) > _COUPLED:
            continue
        text = f"{names[j]} and {names[i]} are correlated by {rho[i, j]:.3f}"
        remarks.append(Remark("collinear", text, names[j], float(rho[i, j]), HIGH))
    return remarks


def _report_lines(fit: OutputError) -> list[str]:
    """Return estimates and noise as lines of text."""
    e, a = fit.estimates, fit.estimates.attrs
    names = [str(name) for name in e["parameter"].values]
    width = max(12, *map(len, names))
    state = "converged" if a["converged"] else "NOT converged"
    lines = [
        f"{a['method']}: manoeuvres {a['manoeuvres']}, samples {a['samples']}, "
        f"iterations {a['iterations']}, {state}",
        f"{'parameter':{width}s}" + "".join(f"{head:>13s}" for head, _, _ in _COLUMNS),
    ]
    for k, name in enumerate(names):
        line = f"{name:{width}s}"
        for _, variable, form in _COLUMNS:
            number = float(e[variable].values[k])
            if variable == "estimate":
                number = _without_rounding(number, float(e["stderr"].values[k]))
            line += f"{number:13{form}}"
        lines.append(line)
    lines += describe_constraints(a.get("constraints", ""))
    heads = "".join(f"{f'noise {k}':>13s}" for k in fit.noise["manoeuvre"].values)
    is_tested = _PRINTED in fit.noise
    if is_tested:
        heads += f"{'P if white':>13s}"
    lines += ["", f"{'output':{width}s}{heads}"]
    for name in fit.noise["output"].values:
        line = f"{name!s:{width}s}"
        for stderr in fit.noise["stderr"].sel(output=name):
            line += f"{float(stderr):13.4g}"
        if is_tested:
            line += f"{float(fit.noise[_PRINTED].sel(output=name)):13.2g}"
        lines.append(line)
    return [*lines, ""]


def _without_rounding(estimate: float, stderr: float) -> float:
    """Return an estimate without its part below 1e-9 standard errors.

    That part depends on the order in which linear algebra sums. It would be printed for an estimate
    that is zero.
    """
    step = 1e-9 * stderr
    if not (np.isfinite(step) and step > 0.0):
        return estimate
    return float(np.round(estimate / step) * step) + 0.0


def save_output_error(fit: OutputError, path: str | os.PathLike) -> None:
    """Write a fit in time to a netCDF-4 file, atomically.

    The file has the groups ``estimates`` (with the report as attribute), ``noise`` and
    ``residuals/1`` ... for each manoeuvre.

    Parameters
    ----------
    fit : OutputError
        From `output_error` or `filter_error`. Such a file cannot contain the complex residuals of a
        fit in frequency.
    path : path
        An existing file is replaced.
    """
    groups = {
        "/": xr.Dataset(attrs={"content": _CONTENT, "warnings": "\n".join(fit.warnings)}),
        "/estimates": fit.estimates.assign_attrs(report=fit.report()),
        "/noise": fit.noise,
    }
    for number, residual in enumerate(fit.residuals, start=1):
        groups[f"/residuals/{number}"] = residual
    with written_atomically(Path(path)) as part:
        write_netcdf(groups, part)


def open_output_error(path: str | os.PathLike) -> OutputError:
    """Read a fit that `save_output_error` wrote.

    Raises
    ------
    ParseError
        A file that is not such a fit.
    """
    tree = open_tree(path, _CONTENT, "a fit as `aeromatch flight fit -o` writes it")
    nodes = tree["residuals"].children
    residuals = []
    # The names are the numbers of the manoeuvres: 10 follows 9.
    for name in sorted(nodes, key=int):
        residuals.append(nodes[name].to_dataset(inherit=False))
    return OutputError(
        estimates=tree.children["estimates"].to_dataset(inherit=False),
        residuals=tuple(residuals),
        noise=tree.children["noise"].to_dataset(inherit=False),
        warnings=tuple(str(tree.attrs.get("warnings", "")).splitlines()),
    )
