"""What a likelihood fit found: estimates, errors, residuals and noise, and in words what a reader
should know.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from flightmech.support.atomic_write import written_atomically
from flighttest.maximum_likelihood.residual_covariance import ResidualNoise, innovation_coupling
from flighttest.maximum_likelihood.search import LikelihoodMaximum, invert_information
from flighttest.maximum_likelihood.unknowns import UnknownVector
from flighttest.regression.equation_error.fit import open_tree
from flighttest.remarks import Remark, remark_lines

HIGH = 0.9  # correlation that is reported
# part of the a-priori standard error that is left where a record contains hardly any information
SILENT = 0.9


@dataclass(frozen=True)
class OutputError:
    """Maximum-likelihood estimates from whole responses.

    Attributes
    ----------
    estimates : Dataset (parameter, parameter_)
        ``estimate``, ``stderr`` (residuals as they are coloured, never below the next),
        ``stderr_white`` (Cramer-Rao bound), ``covariance`` and ``correlation`` (coloured),
        ``information`` (Fisher, prior included), ``start``, ``prior_stderr``, ``low``, ``high`` and
        ``active``: at a bound, without a standard error.  Attributes: ``method``, ``cost``,
        ``iterations``, ``converged``, ``samples``, ``manoeuvres``.
    residuals : tuple of Dataset
        Per manoeuvre measured minus predicted outputs over ``time``, or over ``frequency`` as
        complex numbers.
    noise : Dataset
        ``stderr`` (manoeuvre, output) of the noise, ``covariance`` (output, output_) of the
        residuals of all manoeuvres, and, in time, per output ``slow`` and ``fast``, its disturbance
        and its noise from sample to sample, ``time``, how long the disturbance lasts [s],
        ``block``, the blocks in which it was looked for [s], and ``motion``, rms of the measured
        output about its mean; ``coupling`` (output, output_), above one where two disturbances
        belong together, and the attribute ``effect``, by which part of the motion the error of an
        estimate moves the outputs.
    warnings : tuple of str
        Why the standard errors or the estimates are not to be trusted.
    """

    estimates: xr.Dataset
    residuals: tuple[xr.Dataset, ...]
    noise: xr.Dataset
    warnings: tuple[str, ...] = ()

    @property
    def parameters(self) -> dict[str, float]:
        """The estimates by name, for a simulation; those of one manoeuvre alone are left out."""
        names = [str(name) for name in self.estimates["parameter"].values]
        return {
            name: float(value)
            for name, value in zip(names, self.estimates["estimate"].values)
            if "@" not in name
        }

    def of_manoeuvre(self, number: int) -> dict[str, float]:
        """Return the estimates that hold for one manoeuvre, from 1: the common ones and its own.

        Raises
        ------
        IndexError
            No such manoeuvre.
        """
        if not 1 <= number <= len(self.residuals):
            raise IndexError(f"manoeuvre {number}; there are 1 to {len(self.residuals)}")
        e = self.estimates
        own = {
            str(name): float(e["estimate"].sel(parameter=name)) for name in e["parameter"].values
        }
        return self.parameters | {
            name.removesuffix(f"@{number}"): value
            for name, value in own.items()
            if name.endswith(f"@{number}")
        }

    @property
    def remarks(self) -> list[Remark]:
        """What a reader of the numbers must know."""
        return _remarks(self)

    def report(self) -> str:
        """Return estimates, noise and remarks as text."""
        return _report(self)


def estimates_dataset(
    found: LikelihoodMaximum,
    layout: UnknownVector,
    covariance: np.ndarray,
    about: dict[str, str | float | int],
) -> xr.Dataset:
    """Return the estimates Dataset of a `LikelihoodMaximum`.

    Parameters
    ----------
    found : Found
    layout : Layout
    covariance : array (unknown, unknown)
        Corrected for coloured residuals.
    about : dict
        Further attributes.
    """
    free = ~found.active
    readings = sum(int(np.isfinite(v).sum()) for v in found.residuals)
    white = invert_information(found.information, free) * readings / max(1, readings - len(free))
    # a colour that promises less than white residuals is more often chance than a gift
    grow = np.sqrt(
        np.maximum(
            1.0, np.diag(white) / np.where(np.diag(covariance) > 0.0, np.diag(covariance), np.inf)
        )
    )
    covariance = covariance * np.outer(grow, grow)
    stderr, stderr_white = (
        np.where(free, np.sqrt(np.diag(C)), np.nan) for C in (covariance, white)
    )
    size = np.where(np.isfinite(stderr) & (stderr > 0.0), stderr, np.inf)
    correlation = covariance / np.outer(size, size) + np.diag(np.where(np.isfinite(size), 0.0, 1.0))
    columns = {
        "estimate": found.theta, "stderr": stderr, "stderr_white": stderr_white, "start": layout.start, "prior_stderr": layout.sigma,
        "low": layout.low, "high": layout.high, "active": found.active.astype(np.int8),
    }  # fmt: skip
    square = {
        "covariance": covariance,
        "correlation": correlation,
        "information": found.information,
    }
    names = list(layout.names)
    return xr.Dataset(
        {name: ("parameter", x) for name, x in columns.items()} | {name: (("parameter", "parameter_"), x) for name, x in square.items()},
        {"parameter": names, "parameter_": names},
        {
            **about, "cost": found.cost, "iterations": found.iterations, "converged": int(found.converged),
            "samples": sum(len(v) for v in found.residuals), "manoeuvres": len(found.residuals),
        },
    )  # fmt: skip


def noise_dataset(
    found: LikelihoodMaximum,
    outputs: list[str],
    colours: Sequence[ResidualNoise] = (),
    measured: Sequence[np.ndarray] = (),
    effect: float = 0.0,
) -> xr.Dataset:
    """Return the noise Dataset of a `LikelihoodMaximum`; `colours` of residuals in time go with the outputs
    `measured` and their `effect`.
    """
    v = np.concatenate(found.residuals)
    count = np.maximum((v != 0.0).T.astype(float) @ (v != 0.0), 1.0)
    data: dict[str, tuple] = {
        "stderr": (("manoeuvre", "output"), np.sqrt(found.noise)),
        "covariance": (("output", "output_"), v.T @ v / count),
    }
    if colours:
        size = np.sqrt(found.noise.mean(axis=0))
        about = np.concatenate([z - np.nanmean(z, axis=0) for z in measured])
        data |= {
            "slow": ("output", [colour.slow * scale for colour, scale in zip(colours, size)]),
            "fast": ("output", [colour.white * scale for colour, scale in zip(colours, size)]),
            "time": ("output", [colour.time for colour in colours]),
            "block": ("output", [colour.block for colour in colours]),
            "motion": ("output", np.sqrt(np.nanmean(about**2, axis=0))),
            "coupling": (
                ("output", "output_"),
                innovation_coupling(
                    np.column_stack([colour.innovations for colour in colours]), colours[0].block
                ),
            ),
        }
    places = {
        "output": outputs,
        "output_": outputs,
        "manoeuvre": np.arange(1, len(found.residuals) + 1),
    }
    return xr.Dataset(data, places, {"effect": effect} if colours else {})


def _remarks(fit: OutputError) -> list[Remark]:
    e = fit.estimates
    names = [str(name) for name in e["parameter"].values]
    found = [Remark("disturbance", text) for text in fit.warnings]
    if not e.attrs["converged"]:
        found.append(
            Remark(
                "convergence",
                f"not converged after {e.attrs['iterations']} iterations",
                severity="error",
            )
        )
    for name, active, value in zip(names, e["active"].values, e["estimate"].values):
        if active:
            words = (
                f"{name} is at its bound {value:g}: it has no standard error, and those of "
                f"the others hold it there"
            )
            found.append(Remark("bound", words, name, float(value), float(value)))
    for name, after, before in zip(names, e["stderr"].values, e["prior_stderr"].values):
        if after > SILENT * before:
            words = (
                f"{name}: the records contain hardly any information, standard error "
                f"{after:.3g} after {before:.3g} before"
            )
            found.append(
                Remark("not significant", words, name, float(after), SILENT * float(before))
            )
    rho = e["correlation"].values
    pairs = [(i, j) for i in range(len(names)) for j in range(i) if abs(rho[i, j]) > HIGH]
    return found + [
        Remark(
            "collinear",
            f"{names[j]} and {names[i]} are correlated by {rho[i, j]:.3f}",
            names[j],
            float(rho[i, j]),
            HIGH,
        )
        for i, j in pairs
    ]


def _report(fit: OutputError) -> str:
    e, width = (
        fit.estimates,
        max(12, *(len(str(name)) for name in fit.estimates["parameter"].values)),
    )
    about, state = e.attrs, "converged" if e.attrs["converged"] else "NOT converged"
    heads = "".join(
        f"{head:>13s}" for head in ("estimate", "std. error", "if white", "start", "prior s.e.")
    )
    text = [
        f"{about['method']}: manoeuvres {about['manoeuvres']}, samples {about['samples']}, "
        f"iterations {about['iterations']}, {state}",
        f"{'parameter':{width}s}{heads}",
    ]
    for k, name in enumerate(e["parameter"].values):
        row = e.isel(parameter=k)
        numbers = [
            float(row[key])
            for key in ("estimate", "stderr", "stderr_white", "start", "prior_stderr")
        ]
        text.append(
            f"{name!s:{width}s}{numbers[0]:13.6g}{numbers[1]:13.3g}{numbers[2]:13.3g}{numbers[3]:13.6g}{numbers[4]:13.3g}"
        )
    text += [
        "",
        f"{'output':{width}s}"
        + "".join(f"{f'noise {k}':>13s}" for k in fit.noise["manoeuvre"].values),
    ]
    for name in fit.noise["output"].values:
        text.append(
            f"{name!s:{width}s}"
            + "".join(f"{float(x):13.4g}" for x in fit.noise["stderr"].sel(output=name))
        )
    return "\n".join([*text, "", *remark_lines(fit.remarks)]).rstrip()


_CONTENT = "output error"


def save_output_error(fit: OutputError, path: str | os.PathLike) -> None:
    """Write a fit in time to a netCDF-4 file, atomically.

    Groups ``estimates`` (with the report as attribute), ``noise`` and ``residuals/1`` ... for each
    manoeuvre.

    Parameters
    ----------
    fit : OutputError
        Of `output_error` or `filter_error`; complex residuals of a fit in frequency have no place
        in such a file.
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
    estimates, noise = (
        tree.children[name].to_dataset(inherit=False) for name in ("estimates", "noise")
    )
    warnings = tuple(str(tree.attrs.get("warnings", "")).splitlines())
    return OutputError(estimates, residuals, noise, warnings)
