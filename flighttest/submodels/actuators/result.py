"""Result of the identification of an actuator.

It contains the estimates of both methods, their average, absolute coefficients, and the entry of a
name map for a record.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.maximum_likelihood.result import OutputError
from flighttest.remarks import PrintedResult, Remark, warn_forbidden
from flighttest.submodels.actuators.estimation import Estimates
from flighttest.submodels.actuators.remarks import (
    contradiction_remarks,
    limit_remarks,
    unconverged_log_remarks,
)
from flighttest.submodels.actuators.response import Structure
from flighttest.submodels.actuators.values import LogEstimates, ValueWithError, average_estimates

# Step of a central difference, in standard errors of the parameter.
_STEP = 1e-4
# Error of amplitude or phase [1, rad] up to which the first-order lag represents the actuator.
_FAST = 0.1


@dataclass(frozen=True)
class IdentifiedActuator(PrintedResult):
    """An identified actuator.

    Attributes
    ----------
    structure : Structure
        Terms of the model. Its limits are those that the logs reached.
    spectral : Estimates
        Equation error in frequency.
    response : OutputError
        Output error in time over all logs. It gives the parameters.
    alone : tuple of LogEstimates
        Output error on each log alone, if there are several.
    logs : tuple of Dataset
        Logs from which the actuator was identified.
    reached : dict of str to float
        Part of the samples at which the response is at each limit.
    selection : tuple of Remark
        Remarks on the comparison of the models with and without limits.
    """

    structure: Structure
    spectral: Estimates
    response: OutputError
    alone: tuple[LogEstimates, ...]
    logs: tuple[xr.Dataset, ...]
    reached: Mapping[str, float]
    selection: tuple[Remark, ...] = ()

    @property
    def absolute(self) -> bool:
        """Whether the coefficients are absolute; without a measured torque only their ratios to Ma
        are determined.
        """
        return self.structure.absolute

    @property
    def parameters(self) -> dict[str, float]:
        """Estimates of the output error by the names of the structure."""
        e = self.response.estimates
        return {
            name: float(e["estimate"].sel(parameter=name)) for name in self.structure.parameters
        }

    @property
    def stderr(self) -> dict[str, float]:
        """Standard errors of the parameters; NaN at a bound.

        The standard error of the dead time contains the unknown time of a jump between two samples.
        """
        e = self.response.estimates
        errors = {
            name: float(e["stderr"].sel(parameter=name)) for name in self.structure.parameters
        }
        if "delay" in errors and not self.structure.held:
            # Standard deviation of a uniform distribution over one sampling step.
            step = max(float(np.diff(log["time"].values).mean()) for log in self.logs)
            errors["delay"] = math.hypot(errors["delay"], step / math.sqrt(12.0))
        return errors

    @property
    def fit(self) -> float:
        """Lowest R2 of the simulated response among the outputs, over all logs."""
        R2 = []
        for name in self.response.residuals[0].data_vars:
            residual = np.concatenate([log[name].values for log in self.response.residuals])
            z = np.concatenate(
                [log[name].values - np.nanmean(log[name].values) for log in self.logs]
            )
            R2.append(1.0 - float(np.nansum(residual**2) / np.nansum(z**2)))
        return min(R2)

    def table(self) -> pd.DataFrame:
        """Return both methods side by side as [Grauer2010] Table 1 does.

        Returns
        -------
        DataFrame
            Index parameter; ``frequency``, ``frequency_stderr``, ``time``, ``time_stderr``,
            ``average``, ``average_stderr`` (weights 1/s), ``disagreement`` in combined standard
            errors and ``contradictory`` above three of them.  NaN if a method has no estimate.
        """
        rows = {}
        for name, value in self.parameters.items():
            s = self.stderr[name]
            spectral = self.spectral.values.get(name, math.nan)
            s_spectral = self.spectral.stderr.get(name, math.nan)
            average = average_estimates([spectral, value], [s_spectral, s])
            rows[name] = {
                # An estimate without a standard error is not shown.
                "frequency": spectral if math.isfinite(s_spectral) else math.nan,
                "frequency_stderr": s_spectral,
                "time": value,
                "time_stderr": s,
                "average": average.value if average else math.nan,
                "average_stderr": average.stderr if average else math.nan,
                "disagreement": math.nan,
                "contradictory": bool(average and average.contradictory),
            }
            if average and average.count > 1:
                rows[name]["disagreement"] = average.disagreement
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")

    def over_logs(self) -> pd.DataFrame:
        """Return the output error on each log alone, averaged with weights 1/s.

        Returns
        -------
        DataFrame
            Index parameter; ``average``, ``stderr``, ``disagreement``, ``contradictory``,
            ``count``.  Empty for a single log.  A log whose search did not converge is left out.
        """
        rows = {}
        logs = [log for log in self.alone if log.converged]
        for name in self.structure.parameters:
            values = [log.values[name] for log in logs]
            average = average_estimates(values, [log.stderr[name] for log in logs])
            if average and average.count > 1:
                rows[name] = {
                    "average": average.value,
                    "stderr": average.stderr,
                    "disagreement": average.disagreement,
                    "contradictory": average.contradictory,
                    "count": average.count,
                }
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")

    def with_inertia(self, Ma: float, stderr: float = 0.0) -> dict[str, ValueWithError]:
        """Return absolute coefficients from ratios and a known inertia.

        Parameters
        ----------
        Ma, stderr : float
            Inertia of the moving parts at the output and its standard error. [kg m2]

        Raises
        ------
        IdentificationError
            The coefficients are absolute already, or the inertia is not positive.
        """
        if self.absolute:
            raise IdentificationError("the coefficients are absolute already")
        if not Ma > 0.0:
            raise IdentificationError(f"inertia {Ma:g} kg m2; it must be positive")
        values, errors = self.parameters, self.stderr
        coefficients = {"Ma": ValueWithError(Ma, stderr)}
        for name in self.structure.coefficients:
            # First-order error of a product of independent factors.
            coefficients[name.removesuffix("/Ma")] = ValueWithError(
                Ma * values[name], math.hypot(Ma * errors[name], stderr * values[name])
            )
        return coefficients

    def derived(self) -> dict[str, ValueWithError]:
        """Return quantities that describe the response.

        Returns
        -------
        dict of str to Value
            Servo: ``natural_frequency`` [rad/s], ``damping_ratio``, ``gain`` [rad per unit of the
            command], ``offset``, the position at command zero [rad], ``lag``, the first-order lag
            of the same phase at low frequency, Ca/Ka [s].  Motor: ``gain`` [rad/s per unit of the
            command], ``offset`` [rad/s], ``lag``, Ma/Ca [s].
        """
        ratio = self._ratio
        # With a stiffness the response is of second order, without it a lag of first order.
        if self.structure.stiffness:
            functions: dict[str, Callable[[Mapping[str, float]], float]] = {
                "natural_frequency": lambda x: math.sqrt(ratio(x, "Ka")),
                "damping_ratio": lambda x: ratio(x, "Ca") / (2.0 * math.sqrt(ratio(x, "Ka"))),
                "gain": lambda x: ratio(x, "B") / ratio(x, "Ka"),
                "offset": lambda x: -x["neutral"] * ratio(x, "B") / ratio(x, "Ka"),
                "lag": lambda x: ratio(x, "Ca") / ratio(x, "Ka"),
            }
        else:
            functions = {
                "gain": lambda x: ratio(x, "B") / ratio(x, "Ca"),
                "offset": lambda x: -x["neutral"] * ratio(x, "B") / ratio(x, "Ca"),
                "lag": lambda x: 1.0 / ratio(x, "Ca"),
            }
        return {name: self._with_error(function) for name, function in functions.items()}

    def _ratio(self, values: Mapping[str, float], name: str) -> float:
        """Return a coefficient divided by Ma."""
        return values[name] / values["Ma"] if self.absolute else values[f"{name}/Ma"]

    def _with_error(self, function: Callable[[Mapping[str, float]], float]) -> ValueWithError:
        """Return a function of the parameters with its standard error to first order."""
        names = list(self.structure.parameters)
        values, errors = self.parameters, self.stderr
        slope = np.zeros(len(names))
        for k, name in enumerate(names):
            step = _STEP * errors[name]
            # A parameter at a bound has no standard error and contributes none.
            if np.isfinite(step) and step > 0.0:
                up, down = values[name] + step, values[name] - step
                slope[k] = (function({**values, name: up}) - function({**values, name: down})) / (
                    2.0 * step
                )
        C = self.response.estimates["covariance"].sel(parameter=names, parameter_=names).values
        variance = float(slope @ np.where(np.isfinite(C), C, 0.0) @ slope)
        return ValueWithError(function(values), math.sqrt(max(0.0, variance)))

    @property
    def valid_to(self) -> float:
        """Frequency up to which gain, lag and dead time represent the servo. [Hz]

        The errors are 10 % of amplitude and 0.1 rad of phase.
        """
        if not self.structure.stiffness:
            return math.inf
        values = {name: quantity.value for name, quantity in self.derived().items()}
        # Response of the servo divided by that of a lag: its logarithm is (amplitude, phase) error.
        f = np.geomspace(1e-3, 1e3, 6001) * values["natural_frequency"]
        second = 1.0 / (1.0 - (f / values["natural_frequency"]) ** 2 + 1j * f * values["lag"])
        error = np.abs(np.log(second * (1.0 + 1j * f * values["lag"])))
        return float(f[np.argmax(error > _FAST)] / (2.0 * np.pi))

    @property
    def remarks(self) -> list[Remark]:
        """Remarks on the estimates."""
        return _remarks(self)

    def channel(self, name: str = "delta_e", column: str = "command") -> str:
        """Return the entry of a name map that makes a surface position of a recorded command.

        The entry contains gain, neutral, lag, dead time and limits.

        Parameters
        ----------
        name : str
            Channel of the record, such as ``delta_e``.
        column : str
            Column of the command in the flight log.

        Raises
        ------
        IdentificationError
            A motor: its command makes a rate and no position.

        Warns
        -----
        AeromatchWarning
            A remark forbids the use of the estimates, such as a search that did not converge.
        """
        if not self.structure.stiffness:
            raise IdentificationError(
                "a motor's command makes a rate; only a servo gives an entry of a name map"
            )
        warn_forbidden(self.remarks, f"entry of {name}")
        derived, delay = self.derived(), self.parameters.get("delay", 0.0)
        parts = [
            f'column = "{column}"',
            f'scale = "{derived["gain"].value:.6g} rad"',
            f'offset = "{derived["offset"].value:.6g} rad"',
        ]
        parts.append(f'lag = "{-derived["lag"].value:.4g} s"')
        if delay:
            parts.append(f'delay = "{-delay:.4g} s"')
        if "rate_limit" in self.reached:
            parts.append(f'rate_limit = "{self.parameters["rate_limit"]:.4g} rad/s"')
        if {"stop_low", "stop_high"} & set(self.reached):
            stops = {"stop_low": "-inf", "stop_high": "inf"}
            for stop in set(stops) & set(self.reached):
                stops[stop] = f'"{self.parameters[stop]:.4g} rad"'
            parts.append(f"stops = [{stops['stop_low']}, {stops['stop_high']}]")
        return f"{name} = {{ {', '.join(parts)} }}"

    def as_dict(self) -> dict[str, Any]:
        """Return everything for JSON."""
        return {
            "absolute": self.absolute,
            "parameters": {
                name: {"value": value, "stderr": self.stderr[name]}
                for name, value in self.parameters.items()
            },
            "methods": self.table().to_dict("index"),
            "logs": self.over_logs().to_dict("index"),
            "derived": {name: vars(quantity) for name, quantity in self.derived().items()},
            "reached": dict(self.reached),
            "R2": {"frequency": self.spectral.R2, "time": self.fit},
            "iterations": int(self.response.estimates.attrs["iterations"]),
            "converged": bool(self.response.estimates.attrs["converged"]),
            "instruments": _instruments(self.spectral),
            "remarks": [remark.as_dict() for remark in self.remarks],
        }

    def report_lines(self) -> list[str]:
        """Return equation, estimates of both methods and derived quantities as lines."""
        return [*_equation_lines(self), *_table_lines(self), "", *_quantity_lines(self), ""]


def _remarks(actuator: IdentifiedActuator) -> list[Remark]:
    """Return remarks on ratios, contradictions, limits and the fit."""
    remarks = []
    if not actuator.absolute:
        text = (
            "no torque was measured: the coefficients are ratios to Ma, none is absolute; a "
            "known inertia makes them so"
        )
        remarks.append(Remark("ratios", text, severity="note"))
    remarks += contradiction_remarks(
        actuator.table(),
        "frequency and time domain differ by {:.1f} combined standard errors; their average hides "
        "a contradiction. A limit, friction, or noise of the motion biases the equation error",
    )
    remarks += contradiction_remarks(
        actuator.over_logs(),
        "two logs differ by {:.1f} combined standard errors; load, supply voltage or amplitude "
        "changed",
    )
    if actuator.structure.stiffness:
        remarks += limit_remarks(actuator.logs, actuator.reached)
    remarks += [*actuator.spectral.remarks, *actuator.selection]
    remarks += unconverged_log_remarks(actuator.alone)
    # Ratios to Ma are always correlated. The correlation is in every derived quantity and needs no
    # action of the reader.
    for remark in actuator.response.remarks:
        if remark.kind != "collinear" and not remark.term.startswith("init."):
            remarks.append(remark)
    return remarks


def _instruments(spectral: Estimates) -> dict[str, Any] | None:
    """Return the end of the iteration over the instruments for JSON."""
    return None if spectral.convergence is None else spectral.convergence.as_dict()


_CELLS = ("frequency", "frequency_stderr", "time", "time_stderr", "average", "average_stderr")


def _equation_lines(actuator: IdentifiedActuator) -> list[str]:
    """Return the equation and the figures of the fit as lines of text."""
    attrs = actuator.response.estimates.attrs
    state = "converged" if attrs["converged"] else "NOT converged"
    kind, spring = ("servo", "+ Ka p ") if actuator.structure.stiffness else ("motor", "")
    scale = "absolute coefficients" if actuator.absolute else "ratios to Ma"
    return [
        f"{kind}: Ma v' + Ca v {spring}+ G tau = B (u - neutral); {scale}",
        f"logs {len(actuator.logs)}, samples {attrs['samples']}, R2 of the response "
        f"{actuator.fit:.4f}, of the spectra {actuator.spectral.R2:.4f}, "
        f"iterations {attrs['iterations']}, {state}",
        "",
    ]


def _table_lines(actuator: IdentifiedActuator) -> list[str]:
    """Return the table of the parameters by both methods as lines of text."""
    lines = [
        f"{'parameter':14s}{'frequency':>13s}{'std. error':>11s}{'time':>13s}{'std. error':>11s}"
        f"{'average 1/s':>13s}{'std. error':>11s}{'apart':>8s}",
    ]
    for name, row in actuator.table().iterrows():
        # Value and standard error alternate, with five and three digits.
        cells = ""
        for cell in _CELLS:
            width, digits = (11, 3) if cell.endswith("_stderr") else (13, 5)
            cells += _cell(row[cell], width, f".{digits}g")
        mark = " !" if row["contradictory"] else ""
        lines.append(f"{name:14s}{cells}{_cell(row['disagreement'], 8, '.1f')}{mark}")
    return lines


def _cell(value: float, width: int, style: str) -> str:
    """Return a number in a cell of a table; a dash for NaN."""
    return f"{value:{width}{style}}" if math.isfinite(value) else f"{'-':>{width}s}"


def _quantity_lines(actuator: IdentifiedActuator) -> list[str]:
    """Return derived quantities, dead time and limits with their units as lines of text."""
    units = {
        "natural_frequency": "rad/s",
        "damping_ratio": "",
        "lag": "s",
        "gain": "rad per unit of command",
        "offset": "rad",
    }
    if not actuator.structure.stiffness:
        units |= {"gain": "rad/s per unit of command", "offset": "rad/s"}
    lines = ["used: the output error in time"]
    for name, value in actuator.derived().items():
        lines.append(f"  {name.replace('_', ' '):18s} {value} {units[name]}".rstrip())
    if "delay" in actuator.parameters:
        delay = ValueWithError(actuator.parameters["delay"], actuator.stderr["delay"])
        lines.append(f"  {'dead time':18s} {delay} s")
    for name, part in actuator.reached.items():
        limit = ValueWithError(actuator.parameters[name], actuator.stderr[name])
        lines.append(
            f"  {name.replace('_', ' '):18s} {limit}, held in {100.0 * part:.1f} % of samples"
        )
    if actuator.structure.stiffness:
        lines.append(
            f"  the first-order lag holds to {actuator.valid_to:.2g} Hz (10 % of amplitude, 0.1 "
            f"rad of phase)"
        )
    return lines
