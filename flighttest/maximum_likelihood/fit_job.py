"""Output-error fit from a specification, with its records and its report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import aerodb
from flightmech.flown_samples import (
    CHANNELS,
    FLOWN_SAMPLES,
    FlownWindow,
    cut_windows,
    pack_windows,
    with_flown_samples,
)
from flightmech.flown_states import FLOWN_STATES, gather_states, pack_states
from flightmech.simulation.compiler import SimModel, compile_files
from flightmech.support.console import to_json_types
from flighttest.maximum_likelihood.database_update import updated_database
from flighttest.maximum_likelihood.nonlinear.simulated_filter_error import simulated_filter_error
from flighttest.maximum_likelihood.result import OutputError
from flighttest.maximum_likelihood.specification import Specification
from flighttest.maximum_likelihood.time_domain import output_error, uniform_step
from flighttest.reconstruction.dynamics.force_coefficients import select_time
from flighttest.reconstruction.dynamics.saved_paths import open_states
from flighttest.reconstruction.quality.manoeuvre_faults import report_faults
from flighttest.records.signals.white_noise import estimate_white_noise
from flighttest.remarks import PrintedResult, Remark, remarks_to_json

POOR = 0.5  # share of the variance of an output about its mean that the model must explain
RUNAWAY = 1.5  # error over movement of an output beyond which the motion runs away
# Standard deviation of an output over its white noise: a smaller one is not a movement. At this
# limit a model without error explains 56 % of the variance, just more than POOR.
_CLEAR = 1.5
_STILL = 1e-3  # [SI] standard deviation of an output at rest whose record has no noise
PULLED = 3.0  # prior standard errors by which an estimate may depart before it is reported


@dataclass(frozen=True)
class FitJobResult(PrintedResult):
    """A fit with its specification, model and records.

    Attributes
    ----------
    specification : Specification
    sim : SimModel
    records : tuple of Dataset
        The manoeuvres.
    fit : OutputError
    """

    specification: Specification
    sim: SimModel
    records: tuple[xr.Dataset, ...]
    fit: OutputError

    @property
    def explained(self) -> xr.DataArray:
        """Share of the variance of each output that the model explains, (manoeuvre, output).

        NaN for an output that neither the record nor the model moves: there is nothing to explain.
        """
        names = list(self.fit.residuals[0].data_vars)
        # one minus the mean square of the residual over that of the output about its mean
        shares = np.full((len(self.records), len(names)), np.nan)
        for k, (record, residual) in enumerate(zip(self.records, self.fit.residuals)):
            for j, name in enumerate(names):
                measured, left = record[name].values, residual[name].values
                # the mean of equal samples differs from them by rounding
                variation = np.var(measured) if np.ptp(measured) > 0.0 else 0.0
                if max(variation, np.var(measured - left)) > _rest_level(measured) ** 2:
                    # the error of a constant record has no share of its movement
                    with np.errstate(divide="ignore"):
                        shares[k, j] = 1.0 - np.mean(left**2) / variation
        return xr.DataArray(
            shares,
            {"manoeuvre": np.arange(1, len(shares) + 1), "output": names},
            ("manoeuvre", "output"),
        )

    @property
    def remarks(self) -> list[Remark]:
        """Outputs that the model does not explain, and estimates far from their prior.

        Further remarks are those of `OutputError.remarks`.
        """
        remarks = []
        explained = self.explained
        # the share of an output at rest is NaN, which is not below the limit
        for (k, j), share in np.ndenumerate(explained.values):
            if share < POOR:
                name = str(explained["output"].values[j])
                part = f"{share:.0%}" if share >= 0.0 else "none"
                text = (
                    f"record {k + 1}, {name}: the model explains {part} of its "
                    f"movement; a term is missing, or the record is wrong"
                )
                if _error_ratio(share) > RUNAWAY:
                    text = f"record {k + 1}, {self._unreproduced(name, float(share))}"
                remarks.append(Remark("unexplained", text, name, float(share), POOR))
        e = self.fit.estimates
        starts, sigmas = e["start"].values, e["prior_stderr"].values
        # An estimate without a prior has an infinite sigma.
        for name, value, start, sigma in zip(
            e["parameter"].values, e["estimate"].values, starts, sigmas
        ):
            if abs(value - start) > PULLED * sigma:
                distance = float(abs(value - start) / sigma)
                text = (
                    f"{name} lies {distance:.1f} prior standard errors from {start:g}: check "
                    f"units, signs and model"
                )
                remarks.append(Remark("prior", text, str(name), distance, PULLED))
        return remarks

    def unreproduced(self) -> list[str]:
        """Return a line for every record with outputs that the model does not reproduce.

        The error of the model is there more than `RUNAWAY` times the movement of the output.
        Simulated over the window, the motion runs away from the flight.  An output at rest in
        record and model is not listed: any small offset is many times its movement.
        """
        lines = []
        for k, row in enumerate(self.explained.values, 1):
            pairs = zip(self.explained["output"].values, row, strict=True)
            texts = [
                self._unreproduced(str(name), float(share))
                for name, share in pairs
                if _error_ratio(share) > RUNAWAY
            ]
            if texts:
                lines.append(f"record {k}: {'; '.join(texts)}")
        return lines

    @staticmethod
    def _unreproduced(name: str, share: float) -> str:
        """Return the words for an output whose error is clearly larger than its movement."""
        size = f"its error is {_error_ratio(share):.2g} times the movement of {name}"
        if np.isinf(share):
            size = f"the model moves {name}, and the record holds it constant"
        return (
            f"{name}: the model does not reproduce the record: {size}; free more parameters (lift, "
            f"drag and trim), shorten the window, or check the channel, mass, thrust and units"
        )

    def report_lines(self) -> list[str]:
        """Return estimates, noise and explained shares as lines."""
        lines = []
        if self.specification.title:
            lines.append(self.specification.title)
        heading = "explained of each output's movement:"
        if str(self.fit.estimates.attrs["method"]).startswith("filter"):
            heading = "explained of each output's movement, predicted one sample ahead:"
        lines += [self.fit.report(), "", heading]
        explained = self.explained
        width = max(map(len, explained["output"].values))
        for name in explained["output"].values:
            line = f"  {name!s:{width}s}"
            for share in explained.sel(output=name):
                line += f"{explained_text(float(share)):>9s}"
            lines.append(line)
        return lines

    def as_dict(self) -> dict[str, Any]:
        """Return estimates and remarks as JSON types."""
        shares = {}
        for name in self.explained["output"].values:
            shares[str(name)] = self.explained.sel(output=name).values
        found = self.fit.as_dict()
        found["remarks"] += remarks_to_json(self.remarks)
        return to_json_types({"title": self.specification.title, **found, "explained": shares})

    def write_database(self, path: str | Path) -> list[str]:
        """Write the database with the estimates; return the parameters that it cannot contain."""
        database = aerodb.open(self.specification.database)
        updated, unplaced = updated_database(database, self.fit)
        windows: list[FlownWindow] = []
        for record in self.records:
            channels = {name: record[name].values for name in CHANNELS if name in record}
            time = record["time"].values.astype(float)
            windows += cut_windows(str(record.attrs["record"]), time, channels)
        flown = {
            FLOWN_SAMPLES: pack_windows(windows),
            FLOWN_STATES: pack_states(gather_states(self.records)),
        }
        updated.attrs |= with_flown_samples(database.attrs, flown)
        aerodb.save(updated, path)
        return unplaced


def _rest_level(samples: np.ndarray) -> float:
    """Return the standard deviation up to which an output is at rest. [SI]"""
    steps = np.abs(np.diff(samples))
    # A channel at rest between two recorded digits changes from one to the other.
    digit = np.min(steps, where=steps > 0.0, initial=np.inf)
    if not np.isfinite(digit):
        return _STILL
    return max(_CLEAR * estimate_white_noise(samples), float(digit), _STILL)


def _error_ratio(share: float) -> float:
    """Return the error over the movement of an output, both as root mean squares."""
    return float(np.sqrt(1.0 - share))


def explained_text(share: float) -> str:
    """Return the share of a movement that a model explains in words.

    Parameters
    ----------
    share : float
        NaN for an output at rest in record and model.

    Examples
    --------
    >>> explained_text(0.981), explained_text(-68.5), explained_text(float("nan"))
    ('98.1%', 'none', 'at rest')
    """
    if np.isnan(share):
        return "at rest"
    # an error larger than the movement has no share of it
    return f"{share:.1%}" if share >= 0.0 else "none"


def perform_fit_job(specification: Specification) -> FitJobResult:
    """Perform a fit by output error, or by filter error if the specification has process noise.

    Parameters
    ----------
    specification : Specification

    Returns
    -------
    FitJobResult

    Raises
    ------
    SchemaError
        Records whose signs, units or axes are wrong, by name; unknowns without a start.
    ParseError, UnknownName, OutOfRange, IdentificationError
        As `output_error`, and for files and windows.

    Warns
    -----
    AeromatchWarning
        Records without excitation, or inputs that move together.
    """
    sim = compile_files(str(specification.aircraft), str(specification.database))
    # Windows and clocks are validated before the first simulation.
    records, names = [], []
    for table in specification.record:
        states = open_states(table.file)
        if table.window:
            states = select_time(states, *table.window)
        uniform_step(states["time"].values.astype(float), table.file.name)
        records.append(states.assign_attrs(record=table.file.stem))
        names.append(table.file.name)
    report_faults(records, names)
    unknowns, gusts = specification.disturbances(records)
    # given parameters replace the starts of the disturbance
    unknowns = unknowns | specification.unknowns(sim)
    shared: dict[str, Any] = {
        "outputs": specification.outputs,
        "conditions": specification.fixed_conditions(sim),
        "noise": specification.noise,
        "iterations": specification.iterations,
        "constraints": specification.constraints,
    }
    if specification.process_noise.kind == "none":
        fit = output_error(sim, records, unknowns, **shared)
    else:
        fit = simulated_filter_error(sim, records, unknowns, gusts=gusts, **shared)
    return FitJobResult(specification, sim, records=tuple(records), fit=fit)
