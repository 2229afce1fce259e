"""Search of the unknowns of one spool that the lever governs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np
import scipy
import xarray as xr

from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.errors import IdentificationError
from flightmech.terms import make_term
from flighttest.maximum_likelihood.result import OutputError
from flighttest.maximum_likelihood.unknowns import Unknown
from flighttest.submodels.engine import bench
from flighttest.submodels.engine.schedule import (
    first_rates,
    first_schedule,
    reading_noise,
)
from flighttest.submodels.engine.tables import FINE, EngineCurve, EngineTable2D

# Ranges of the search.
QUICKEST, SLOWEST = 0.02, 30.0  # time constants [s]
LEAST_RATE, MOST_RATE = 1e-3, 10.0  # rate limits [1/s]
LONGEST = 2.0  # transport delay [s]
# Standard errors from zero above which the ratio of the time constants depends on speed (1 %).
SIGNIFICANT = 2.6
# Internal step [s] and iterations of the first, rough search.
ROUGH, FEW = 0.1, 8
# Residual over the noise of the readings above which the model lacks an effect.
NOISY = 3.0
# First time constant where rate limits govern. [s]
QUICK = 0.1
# Standard error over its a-priori value above which the records do not determine an unknown.
SEEN = 0.9
# Nodes that the kernel changes in one simulation, less a few.
MOST_NODES = 250
# A-priori standard error of the logarithm of a time constant or limit. It keeps an unknown that no
# record determines.
_VAGUE = 2.0
# A-priori standard error of a change with the flight condition.
_CHANGE = {"command": 0.1, "time": 1.0, "limit": 1.0}


class GovernedSpool:
    """Unknowns of a spool that the lever governs, with `search`, which estimates them.

    The order of the unknowns is: delay (unless it is fixed), schedule, ln tau, then ln f and its
    slope or the limits.

    Parameters
    ----------
    name : str
        ``n1`` or ``n2``.
    lever, speed : array (knot,)
        Knots of the schedule [1], and of the dynamics over n2 [1].
    over : mapping of str to sequence of float
        Flight condition with which the tables change, and its breakpoints. [SI]
    limits : bool
        Rate limits over n2; without them the time constants differ by direction.
    delay : float, optional
        Transport delay of the lever [s]; an unknown unless given.
    fixed : mapping of str to Dataset, optional
        Tables of the other spool, which are not estimated.

    Raises
    ------
    IdentificationError
        The tables have more nodes than the kernel changes in one simulation.
    """

    def __init__(
        self,
        name: str,
        lever: np.ndarray,
        speed: np.ndarray,
        over: Mapping[str, Sequence[float]],
        limits: bool,
        delay: float | None = None,
        fixed: Mapping[str, xr.Dataset] | None = None,
    ):
        self.name, self.limits, self.delay, self.fixed = name, limits, delay, dict(fixed or {})
        self.middle = 0.5 * (speed[0] + speed[-1])
        # Fine nodes multiply over the axes; with limits or conditions only the knots are nodes.
        spacing = np.inf if limits or over else FINE
        self.surfaces = dict(self._surfaces(lever, speed, over=over, spacing=spacing))
        size = sum(surface.size for surface in self.surfaces.values())
        if size > MOST_NODES:
            raise IdentificationError(
                f"the tables of {name} have {size} nodes, more than {MOST_NODES}; give fewer "
                f"knots (throttle, n2) or breakpoints (over)"
            )
        self.lever, self.speed = lever, speed
        # Slices of the unknowns by table; the delay precedes them if it is an unknown.
        start = 1 if delay is None else 0
        self.slices = {}
        for table, surface in self.surfaces.items():
            self.slices[table] = slice(start, start + surface.count)
            start += surface.count

    def _surfaces(
        self,
        lever: np.ndarray,
        speed: np.ndarray,
        over: Mapping[str, Sequence[float]],
        spacing: float,
    ) -> Iterator[tuple[str, EngineTable2D]]:
        """Yield the tables of the unknowns by name."""
        yield f"{self.name}_command", EngineTable2D("throttle", lever, over, spacing)
        if not self.limits:
            yield f"{self.name}_up_time", EngineTable2D("n2", speed, over, spacing)
            return
        yield f"{self.name}_up_time", EngineTable2D("n2", speed[[0, -1]], spacing=spacing)
        for direction in ("up", "down"):
            yield f"{self.name}_{direction}_limit", EngineTable2D("n2", speed, over, spacing)

    def tables(self, theta: np.ndarray) -> dict[str, np.ndarray]:
        """Return the nodes of the tables from the unknowns."""
        nodes = {
            table: surface.nodes(theta[self.slices[table]])
            for table, surface in self.surfaces.items()
        }
        up_time = f"{self.name}_up_time"
        if not self.limits:
            # ln tau_down = ln tau_up + ln f + g (n2 - middle)
            n2 = self.surfaces[up_time].axes["n2"]
            ratio = theta[-2] + theta[-1] * (n2 - self.middle)
            flat = [1] * (nodes[up_time].ndim - 1)
            nodes[f"{self.name}_down_time"] = nodes[up_time] + ratio.reshape(-1, *flat)
        # The unknowns of all tables but the schedule are logarithms.
        for table, value in nodes.items():
            if not table.endswith("_command"):
                nodes[table] = np.exp(value)
        return nodes

    def axes(self, table: str) -> dict[str, np.ndarray]:
        """Return the breakpoints of a table."""
        return self.surfaces[table.replace("_down_time", "_up_time")].axes

    def _parameters(self, theta: np.ndarray) -> dict[str, float]:
        """Return the parameters of the kernel from the unknowns."""
        parameters = {}
        if self.delay is None:
            parameters[bench.kernel_parameter("lever_delay")] = float(theta[0])
        for table, values in self.tables(theta).items():
            if table.endswith("_time"):
                values = np.clip(values, QUICKEST, None)
            parameters |= bench.as_nodes(table, values)
        return parameters

    def search(self, records: Sequence[xr.Dataset]) -> OutputError:
        """Return the fit; a rough search precedes the fine one."""
        rough = self._fit(records, self._start(records), step=ROUGH, iterations=FEW)
        return self._fit(records, rough.estimates["estimate"].values)

    def _start(self, records: Sequence[xr.Dataset]) -> np.ndarray:
        """Return first values of the unknowns from rates and settled speeds."""
        schedule = first_schedule(records, self.name, self.lever)
        times, rates = first_rates(
            records, self.name, lever=self.lever, schedule=schedule, at=self.speed
        )
        up, down = (np.log(np.clip(v, ROUGH, SLOWEST / 2.0)) for v in times)
        up_limit, down_limit = (
            np.log(np.clip(v, 2.0 * LEAST_RATE, MOST_RATE / 2.0)) for v in rates
        )
        first = {
            f"{self.name}_command": schedule,
            f"{self.name}_up_time": np.full(2, np.log(QUICK)) if self.limits else up,
            f"{self.name}_up_limit": up_limit,
            f"{self.name}_down_limit": down_limit,
        }
        parts = [surface.start(first[table]) for table, surface in self.surfaces.items()]
        if self.delay is None:
            parts.insert(0, np.array([0.1]))
        if not self.limits:
            parts.append(np.array([float(np.mean(down - up)), 0.0]))
        return np.concatenate(parts)

    def _unknowns(self, start: np.ndarray, step: float) -> dict[str, Unknown]:
        """Return the unknowns by name with first value, a-priori standard error and bounds."""
        unknowns = {}
        if self.delay is None:
            unknowns["lever_delay"] = Unknown(start[0], low=0.0, high=LONGEST)
        bounds = {
            "command": (-np.inf, np.inf),
            "time": (np.log(max(QUICKEST, 0.5 * step)), np.log(SLOWEST)),
            "limit": (np.log(LEAST_RATE), np.log(MOST_RATE)),
        }
        for table, surface in self.surfaces.items():
            kind = table.rpartition("_")[2]
            spread = 0.3 if kind == "command" else _VAGUE
            label = table if kind == "command" else f"ln {table}"
            names = surface.names(label)
            # Values at the knots come first, then changes with the flight condition.
            for k, (name, value) in enumerate(zip(names, start[self.slices[table]])):
                if k < len(surface.knots):
                    unknowns[name] = Unknown(float(value), spread, *bounds[kind])
                else:
                    unknowns[name] = Unknown(float(value), _CHANGE[kind])
        if not self.limits:
            unknowns["ln ratio"] = Unknown(float(start[-2]), 1.0)
            unknowns["slope of ln ratio"] = Unknown(float(start[-1]), 10.0)
        return unknowns

    def _fit(
        self,
        records: Sequence[xr.Dataset],
        start: np.ndarray,
        step: float = bench.STEP,
        iterations: int = bench.ITERATIONS,
    ) -> OutputError:
        """Return the fit of one search on the kernel."""
        leaves = {
            table: make_term(v, self.axes(table), outside="hold")
            for table, v in self.tables(start).items()
        }
        if list(self.axes(f"{self.name}_command")) == ["throttle"]:
            leaves[f"{self.name}_command"].attrs["outside"] = "linear"
        deck = EngineDeck(
            {**self.fixed, **leaves, "thrust": make_term(0.0)}, lever_delay=self.delay or 0.0
        )
        return bench.fit_engine(
            deck,
            records,
            unknowns=self._unknowns(start, step),
            expand=self._parameters,
            outputs=[self.name],
            step=step,
            iterations=iterations,
            coarse=["lever_delay"] if self.limits else [],
        )

    def result(
        self, fit: OutputError, lever_error: np.ndarray
    ) -> tuple[
        dict[str, EngineCurve], dict[str, tuple[float, float]], dict[str, tuple[float, float]]
    ]:
        """Return the tables, and the constants and changes with their standard errors, of a fit.

        `lever_error` (knot,) is the standard error of the lever positions. [1]
        """
        theta, C = bench.theta_and_covariance(fit)
        theta = theta.copy()
        constants: dict[str, tuple[float, float]] = {}
        if not self.limits:
            slope = float(theta[-1]), float(np.sqrt(C[-1, -1]))
            if abs(slope[0]) <= SIGNIFICANT * slope[1]:
                # Condition the other unknowns on a slope of zero.
                theta -= C[:, -1] / C[-1, -1] * slope[0]
                C = C - np.outer(C[:, -1], C[-1]) / C[-1, -1]
            ratio = float(np.exp(theta[-2]))
            constants = {"ratio": (ratio, ratio * float(np.sqrt(C[-2, -2]))), "ratio_slope": slope}
        if self.delay is None:
            constants = {"lever_delay": (float(theta[0]), float(np.sqrt(C[0, 0])))} | constants
        # An error of the lever position moves the schedule by its slope.
        first = self.slices[f"{self.name}_command"].start
        knots = np.arange(first, first + len(self.lever))
        schedule = scipy.interpolate.PchipInterpolator(self.lever, theta[knots])
        C[knots, knots] += (schedule.derivative()(self.lever) * lever_error) ** 2
        tables = {
            table: EngineCurve.of(self.axes(table), partial(self._table, table), theta=theta, C=C)
            for table in self.tables(theta)
        }
        return tables, constants, self._changes(fit)

    def _table(self, table: str, theta: np.ndarray) -> np.ndarray:
        return self.tables(theta)[table]

    def _changes(self, fit: OutputError) -> dict[str, tuple[float, float]]:
        """Return the unknowns that are changes with the flight condition."""
        rows = fit.estimates
        names = [str(name) for name in rows["parameter"].values]
        changes = {}
        for name, value, stderr in zip(names, rows["estimate"].values, rows["stderr"].values):
            if " from " in name:
                changes[name] = float(value), float(stderr)
        return changes

    def remarks(self, fit: OutputError, records: Sequence[xr.Dataset]) -> Iterator[str]:
        """Yield remarks on unknowns without information and on a large residual."""
        rows = fit.estimates
        vague = rows["stderr"].values > SEEN * rows["prior_stderr"].values
        undetermined = rows["parameter"].values[vague].astype(str)
        if len(undetermined):
            yield f"not seen in the records, kept as it was put in: {', '.join(undetermined)}"
        residual = float(fit.noise["stderr"].values.flat[0])
        noise = reading_noise(records, self.name)
        if residual > NOISY * noise:
            missing = "changes with the flight condition (over)"
            if not self.limits:
                missing = f"rate limits (limits) or {missing}"
            size = f"{residual:.2g} rms, is {residual / noise:.1f} times the noise of the readings"
            yield f"{self.name}: the residual, {size}; look for {missing}"
