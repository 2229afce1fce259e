"""What was found of an actuator: estimates of both methods, their average, what is absolute, and
what a record can use of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.support.figures import demand_drawable, new_figure, write_figure
from flighttest.maximum_likelihood.result import OutputError
from flighttest.records.signals.fourier import finite_fourier, remove_straight_line
from flighttest.regression.combining.pooling import DISAGREEMENT, Pooled, pool
from flighttest.remarks import Remark, remark_lines
from flighttest.submodels.actuators.estimation import Estimates, excited_band
from flighttest.submodels.actuators.response import Structure, simulate_actuator

_STEP = 1e-4  # of a difference, in standard errors of the parameter
# error of amplitude or phase [1, rad] up to which the first-order lag stands for the actuator
_FAST = 0.1


@dataclass(frozen=True)
class LogEstimates:
    """Output error on one log by itself."""

    record: str
    values: Mapping[str, float]
    stderr: Mapping[str, float]


@dataclass(frozen=True)
class ValueWithError:
    """A number with its standard error."""

    value: float
    stderr: float

    def __str__(self) -> str:
        return f"{self.value:.5g} +- {self.stderr:.2g}"


@dataclass(frozen=True)
class IdentifiedActuator:
    """An identified actuator.

    Attributes
    ----------
    structure : Structure
        What the model has; its limits are those that were reached.
    spectral : Estimates
        Equation error in frequency.
    response : OutputError
        Output error in time over all logs: what is used.
    alone : tuple of LogEstimates
        Output error on each log by itself, where there are several.
    logs : tuple of Dataset
    reached : dict of str to float
        Part of the samples that each limit holds.
    """

    structure: Structure
    spectral: Estimates
    response: OutputError
    alone: tuple[LogEstimates, ...]
    logs: tuple[xr.Dataset, ...]
    reached: Mapping[str, float]

    @property
    def absolute(self) -> bool:
        """Whether the coefficients are absolute; without a measured torque only their ratios to Ma
        are determined.
        """
        return self.structure.absolute

    @property
    def parameters(self) -> dict[str, float]:
        """Estimates of the output error by the names of the structure, as `simulate_actuator` takes
        them.
        """
        e = self.response.estimates
        return {
            name: float(e["estimate"].sel(parameter=name)) for name in self.structure.parameters
        }

    @property
    def stderr(self) -> dict[str, float]:
        """Their standard errors; NaN at a bound.  That of the dead time contains where between
        samples the command jumps, see `held`.
        """
        e = self.response.estimates
        found = {name: float(e["stderr"].sel(parameter=name)) for name in self.structure.parameters}
        if "delay" in found and not self.structure.held:
            step = max(float(np.diff(log["time"].values).mean()) for log in self.logs)
            found["delay"] = math.hypot(found["delay"], step / math.sqrt(12.0))
        return found

    @property
    def fit(self) -> float:
        """R2 of the simulated response over all outputs and logs, the lowest output."""
        found = []
        for name in self.response.residuals[0].data_vars:
            rest = np.concatenate([one[name].values for one in self.response.residuals])
            z = np.concatenate(
                [log[name].values - np.nanmean(log[name].values) for log in self.logs]
            )
            found.append(1.0 - float(np.nansum(rest**2) / np.nansum(z**2)))
        return min(found)

    def table(self) -> pd.DataFrame:
        """Return both methods side by side as [Grauer2010] Table 1 does.

        Returns
        -------
        DataFrame
            Index parameter; ``frequency``, ``frequency_stderr``, ``time``, ``time_stderr``,
            ``average``, ``average_stderr`` (weights 1/s), ``disagreement`` in combined standard
            errors and ``contradictory`` above three of them.  NaN where a method has no estimate.
        """
        rows = {}
        for name, value in self.parameters.items():
            s, other, s_other = (
                self.stderr[name],
                self.spectral.values.get(name, math.nan),
                self.spectral.stderr.get(name, math.nan),
            )
            joined = _average([other, value], [s_other, s])
            rows[name] = {
                "frequency": other if math.isfinite(s_other) else math.nan, "frequency_stderr": s_other, "time": value, "time_stderr": s,
                "average": joined.value if joined else math.nan, "average_stderr": joined.stderr if joined else math.nan,
                "disagreement": joined.disagreement if joined and joined.count > 1 else math.nan,
                "contradictory": bool(joined and joined.contradictory),
            }  # fmt: skip
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")

    def over_logs(self) -> pd.DataFrame:
        """Return the output error on each log by itself, averaged with weights 1/s.

        Returns
        -------
        DataFrame
            Index parameter; ``average``, ``stderr``, ``disagreement``, ``contradictory``,
            ``count``.  Empty for a single log.
        """
        rows = {}
        for name in self.structure.parameters:
            having = [(one.values[name], one.stderr[name]) for one in self.alone]
            joined = _average(*map(list, zip(*having))) if having else None
            if joined and joined.count > 1:
                rows[name] = {
                    "average": joined.value, "stderr": joined.stderr, "disagreement": joined.disagreement,
                    "contradictory": joined.contradictory, "count": joined.count,
                }  # fmt: skip
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
            The coefficients are absolute already, or an inertia that is not positive.
        """
        if self.absolute or not Ma > 0.0:
            words = (
                "the coefficients are absolute already"
                if self.absolute
                else f"inertia {Ma:g} kg m2; it must be positive"
            )
            raise IdentificationError(words)
        values, errors = self.parameters, self.stderr
        found = {"Ma": ValueWithError(Ma, stderr)}
        for name in self.structure.coefficients:
            found[name.removesuffix("/Ma")] = ValueWithError(
                Ma * values[name], math.hypot(Ma * errors[name], stderr * values[name])
            )
        return found

    def derived(self) -> dict[str, ValueWithError]:
        """Return what the response looks like.

        Returns
        -------
        dict of str to Value
            Servo: ``natural_frequency`` [rad/s], ``damping_ratio``, ``gain`` [rad per unit of the
            command], ``offset``, the position at command zero [rad], ``lag``, the first-order lag
            of the same phase at low frequency, Ca/Ka [s].  Motor: ``gain`` [rad/s per unit of the
            command], ``offset`` [rad/s], ``lag``, Ma/Ca [s].
        """
        ratio = self._ratio
        if self.structure.stiffness:
            wanted: dict[str, Callable[[Mapping[str, float]], float]] = {
                "natural_frequency": lambda x: math.sqrt(ratio(x, "Ka")),
                "damping_ratio": lambda x: ratio(x, "Ca") / (2.0 * math.sqrt(ratio(x, "Ka"))),
                "gain": lambda x: ratio(x, "B") / ratio(x, "Ka"),
                "offset": lambda x: -x["neutral"] * ratio(x, "B") / ratio(x, "Ka"),
                "lag": lambda x: ratio(x, "Ca") / ratio(x, "Ka"),
            }
        else:
            wanted = {
                "gain": lambda x: ratio(x, "B") / ratio(x, "Ca"),
                "offset": lambda x: -x["neutral"] * ratio(x, "B") / ratio(x, "Ca"),
                "lag": lambda x: 1.0 / ratio(x, "Ca"),
            }
        return {name: self._carried(function) for name, function in wanted.items()}

    def _ratio(self, values: Mapping[str, float], name: str) -> float:
        return values[name] / values["Ma"] if self.absolute else values[f"{name}/Ma"]

    def _carried(self, function: Callable[[Mapping[str, float]], float]) -> ValueWithError:
        """Return a function of the parameters with its standard error to first order."""
        names = list(self.structure.parameters)
        at, errors = self.parameters, self.stderr
        slope = np.zeros(len(names))
        for k, name in enumerate(names):
            step = _STEP * errors[name]
            if np.isfinite(step) and step > 0.0:
                slope[k] = (
                    function({**at, name: at[name] + step})
                    - function({**at, name: at[name] - step})
                ) / (2.0 * step)
        C = self.response.estimates["covariance"].sel(parameter=names, parameter_=names).values
        return ValueWithError(
            function(at),
            math.sqrt(max(0.0, float(slope @ np.where(np.isfinite(C), C, 0.0) @ slope))),
        )

    @property
    def valid_to(self) -> float:
        """Frequency up to which gain, lag and dead time stand for the servo within 10 % of
        amplitude and 0.1 rad of phase. [Hz]
        """
        if not self.structure.stiffness:
            return math.inf
        values = {name: one.value for name, one in self.derived().items()}
        f = np.geomspace(1e-3, 1e3, 6001) * values["natural_frequency"]
        second = 1.0 / (1.0 - (f / values["natural_frequency"]) ** 2 + 1j * f * values["lag"])
        wrong = np.abs(np.log(second * (1.0 + 1j * f * values["lag"])))
        return float(f[np.argmax(wrong > _FAST)] / (2.0 * np.pi))

    @property
    def remarks(self) -> list[Remark]:
        """What a reader of the numbers must know."""
        return _remarks(self)

    def channel(self, name: str = "delta_e", column: str = "command") -> str:
        """Return the entry of a name map that makes the surface position of a recorded command:
        gain, neutral, lag, dead time, limits.

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
        """
        if not self.structure.stiffness:
            raise IdentificationError(
                "a motor's command makes a rate; only a servo gives an entry of a name map"
            )
        found, delay = self.derived(), self.parameters.get("delay", 0.0)
        parts = [
            f'column = "{column}"',
            f'scale = "{found["gain"].value:.6g} rad"',
            f'offset = "{found["offset"].value:.6g} rad"',
        ]
        parts.append(f'lag = "{-found["lag"].value:.4g} s"')
        if delay:
            parts.append(f'delay = "{-delay:.4g} s"')
        if "rate_limit" in self.reached:
            parts.append(f'rate_limit = "{self.parameters["rate_limit"]:.4g} rad/s"')
        if {"stop_low", "stop_high"} & set(self.reached):
            low, high = (
                f'"{self.parameters[stop]:.4g} rad"' if stop in self.reached else free
                for stop, free in (("stop_low", "-inf"), ("stop_high", "inf"))
            )
            parts.append(f"stops = [{low}, {high}]")
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
            "derived": {name: vars(one) for name, one in self.derived().items()},
            "reached": dict(self.reached),
            "R2": {"frequency": self.spectral.R2, "time": self.fit},
            "iterations": int(self.response.estimates.attrs["iterations"]),
            "remarks": [remark.as_dict() for remark in self.remarks],
        }

    def report(self) -> str:
        """Return the result as text."""
        return _report(self)


def _average(values: Sequence[float], stderr: Sequence[float]) -> Pooled | None:
    having = [
        (x, s) for x, s in zip(values, stderr) if math.isfinite(x) and math.isfinite(s) and s > 0.0
    ]
    return pool([x for x, _ in having], [s for _, s in having], "inverse_sigma") if having else None


def _remarks(found: IdentifiedActuator) -> list[Remark]:
    out = []
    if not found.absolute:
        words = (
            "no torque was measured: the coefficients are ratios to Ma, none is absolute; a "
            "known inertia makes them so"
        )
        out.append(Remark("ratios", words, severity="note"))
    for name, row in found.table().iterrows():
        if row["contradictory"]:
            words = (
                f"{name}: frequency and time domain differ by {row['disagreement']:.1f} "
                f"combined standard errors; their average hides a "
                "contradiction. A limit, friction, or noise of the motion biases the equation error"
            )
            out.append(
                Remark("scatter", words, str(name), float(row["disagreement"]), DISAGREEMENT)
            )
    for name, row in found.over_logs().iterrows():
        if row["contradictory"]:
            words = (
                f"{name}: two logs differ by {row['disagreement']:.1f} combined standard "
                f"errors; load, supply voltage or amplitude changed"
            )
            out.append(
                Remark("scatter", words, str(name), float(row["disagreement"]), DISAGREEMENT)
            )
    if found.structure.stiffness:
        if "rate_limit" not in found.reached:
            fastest = max(
                float(np.nanmax(np.abs(log["rate"].values))) if "rate" in log else _fastest(log)
                for log in found.logs
            )
            out.append(
                Remark(
                    "limit",
                    f"no rate limit was reached; the logs reach {fastest:.3g} rad/s",
                    "rate_limit",
                    severity="note",
                )
            )
        if not {"stop_low", "stop_high"} & set(found.reached):
            low, high = (
                reach(float(extreme(log["position"].values)) for log in found.logs)
                for reach, extreme in ((min, np.nanmin), (max, np.nanmax))
            )
            out.append(
                Remark(
                    "limit",
                    f"no stop was reached; the logs reach {low:.3g} to {high:.3g} rad",
                    "stops",
                    severity="note",
                )
            )
    # the ratios share their size: their correlation is in every derived quantity and requires
    # nothing of the reader
    return out + [
        remark
        for remark in found.response.remarks
        if remark.kind != "collinear" and not remark.term.startswith("init.")
    ]


def _fastest(log: xr.Dataset) -> float:
    x, time = log["position"].values, log["time"].values
    return float(np.nanmax(np.abs((x[4:] - x[:-4]) / (time[4:] - time[:-4]))))


def _report(found: IdentifiedActuator) -> str:
    about = found.response.estimates.attrs
    kind = "servo" if found.structure.stiffness else "motor"
    text = [
        f"{kind}: Ma v' + Ca v {'+ Ka p ' if found.structure.stiffness else ''}+ G tau = B "
        f"(u - neutral); "
        f"{'absolute coefficients' if found.absolute else 'ratios to Ma'}",
        f"logs {len(found.logs)}, samples {about['samples']}, R2 of the response "
        f"{found.fit:.4f}, of the spectra {found.spectral.R2:.4f}, "
        f"iterations {about['iterations']}",
        "",
        f"{'parameter':14s}{'frequency':>13s}{'std. error':>11s}{'time':>13s}{'std. error':>11s}"
        f"{'average 1/s':>13s}{'std. error':>11s}{'apart':>8s}",
    ]
    for name, row in found.table().iterrows():
        cells = [
            row[key]
            for key in (
                "frequency",
                "frequency_stderr",
                "time",
                "time_stderr",
                "average",
                "average_stderr",
            )
        ]
        widths = (13, 11) * 3
        shown = "".join(
            f"{x:{w}.{5 if w == 13 else 3}g}" if math.isfinite(x) else f"{'-':>{w}s}"
            for x, w in zip(cells, widths)
        )
        apart = row["disagreement"]
        text.append(
            f"{name:14s}{shown}{f'{apart:8.1f}' if math.isfinite(apart) else '       -'}{' !' if row['contradictory'] else ''}"
        )
    text += ["", "used: the output error in time"]
    units = {
        "natural_frequency": "rad/s",
        "damping_ratio": "",
        "lag": "s",
        "gain": "rad per unit of command",
        "offset": "rad",
    }
    if kind == "motor":
        units |= {"gain": "rad/s per unit of command", "offset": "rad/s"}
    text += [
        f"  {name.replace('_', ' '):18s} {value} {units[name]}".rstrip()
        for name, value in found.derived().items()
    ]
    if "delay" in found.parameters:
        text.append(
            f"  {'dead time':18s} "
            f"{ValueWithError(found.parameters['delay'], found.stderr['delay'])} s"
        )
    for name, part in found.reached.items():
        text.append(
            f"  {name.replace('_', ' '):18s} "
            f"{ValueWithError(found.parameters[name], found.stderr[name])}, held in "
            f"{100.0 * part:.1f} % of samples"
        )
    if kind == "servo":
        text.append(
            f"  the first-order lag holds to {found.valid_to:.2g} Hz (10 % of amplitude, 0.1 "
            f"rad of phase)"
        )
    return "\n".join([*text, "", *remark_lines(found.remarks)]).rstrip()


_RECORDED, _MODEL, _REST = "black", "#bc6c25", "#2a6f97"
_BEYOND = 1.5  # times the upper edge of the excited band


def draw_actuator(found: IdentifiedActuator, target: str | Path) -> None:
    """Draw each log: motion, simulated response and residual in time on the left, their spectra on
    the right.

    Parameters
    ----------
    found : IdentifiedActuator
    target : path
        File to write, atomically; its ending names the format (png, svg, pdf).

    Raises
    ------
    SchemaError
        A format that is not drawn.
    AeromatchError
        matplotlib is not installed.
    """
    demand_drawable(target)
    servo = found.structure.stiffness
    name, unit, factor = ("position", "deg", np.degrees(1.0)) if servo else ("rate", "rad/s", 1.0)
    figure = new_figure(14.0, 3.5 * len(found.logs))
    axes = figure.subplots(len(found.logs), 2, squeeze=False, width_ratios=(2, 1))
    for k, (log, (over_time, spectrum)) in enumerate(zip(found.logs, axes), 1):
        time, z = log["time"].values, factor * log[name].values
        y = (
            factor
            * simulate_actuator(log, found.structure, found.response.of_manoeuvre(k))[name].values
        )
        over_time.plot(time, z, color=_RECORDED, linewidth=0.8, label="recorded")
        over_time.plot(time, y, color=_MODEL, linewidth=1.0, linestyle="--", label="simulated")
        over_time.plot(time, z - y, color=_REST, linewidth=0.6, label="residual")
        over_time.set_ylabel(f"{name} [{unit}]")
        over_time.set_title(str(log.attrs.get("record", "")), fontsize="small", loc="left")
        good = np.isfinite(z)
        filled, step = np.interp(time, time[good], z[good]), float(np.diff(time).mean())
        f = np.arange(1, len(time) // 2) / (step * (len(time) - 1))
        f = f[f <= _BEYOND * excited_band(log.assign({name: ("time", filled)}))[1]]
        for values, colour, style in (
            (filled, _RECORDED, "-"),
            (y, _MODEL, "--"),
            (filled - y, _REST, "-"),
        ):
            spectrum.semilogy(
                f,
                np.abs(finite_fourier(remove_straight_line(values), step, f)),
                color=colour,
                linewidth=0.8,
                linestyle=style,
            )
        spectrum.set_ylabel(f"|transform| [{unit} s]")
        for axis in (over_time, spectrum):
            axis.grid(linewidth=0.3)
            axis.margins(x=0.01)
    axes[0][0].legend(fontsize="small", ncols=3)
    axes[-1][0].set_xlabel("time [s]")
    axes[-1][1].set_xlabel("frequency [Hz]")
    write_figure(figure, target, dpi=120)
