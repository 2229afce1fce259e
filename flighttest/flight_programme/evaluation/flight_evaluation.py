"""The evaluation of a flight: every part of its plan in order, each part refused by name when the
record does not carry it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.air import P_SEA, T_SEA, atmosphere
from flightmech.aircraft.aircraft import Aircraft, read_aircraft
from flightmech.errors import (
    AeromatchError,
    IdentificationError,
    OutOfRange,
    SchemaError,
    UnknownName,
)
from flightmech.names import quantity_attributes
from flighttest.flight_programme.evaluation.figures_of_merit import (
    FittedLine,
    bounds_in_si,
    collect_figures,
    judge_bounds,
    line_through,
    series_windows,
    window_means,
)
from flighttest.flight_programme.evaluation.plan import (
    EvaluationPlan,
    FitTable,
    Loading,
    PlannedMode,
    TestPointSheet,
    ThrustPoints,
    read_plan,
)
from flighttest.flight_programme.evaluation.result import Evaluation
from flighttest.reconstruction.dynamics.force_coefficients import coefficients, select_time
from flighttest.reconstruction.flight_path import FlightPath
from flighttest.reconstruction.quality.assessment import assess
from flighttest.reconstruction.smoother import reconstruct
from flighttest.records.record import read
from flighttest.records.signals.conditioning import cut
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.submodels.aircraft_properties.eigenmotion import Motion, fit_motion

# of the largest thrust: a deck that corrected fuel flow and Mach do not reproduce better is another
# engine
_RESIDUAL = 0.05
_AIR = ("h_baro", "mach", "temperature")


def mass_after_burn(
    sheet: Loading, aircraft: Aircraft, burnt: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return mass and c.g. after some fuel has been burnt.

    Parameters
    ----------
    sheet : Loading
    aircraft : Aircraft
        For the place of the moment reference point on the mean chord.
    burnt : array
        Fuel used since the sheet was written. [kg]

    Returns
    -------
    mass, x_cg_b : array
        Mass [kg], c.g. forward of the moment reference point [m].

    Raises
    ------
    SchemaError
        No such fuel item, more fuel burnt than taken, or less left than the fuel table reaches.
    """
    items, table = TestPointSheet(sheet.file), TestPointSheet(sheet.fuel_table.file)
    names = [items.text(row, sheet.item) for row in range(len(items.rows))]
    if sheet.fuel not in names:
        raise SchemaError(
            f"sheet {sheet.file}", [f"no item {sheet.fuel}; there are: {', '.join(names)}"]
        )
    dry = [row for row, name in enumerate(names) if name != sheet.fuel]
    masses = sheet.mass.of(items, "kg")
    items.rows = [items.rows[row] for row in dry]
    moment = float((masses[dry] * sheet.station.of(items, "m")).sum())
    left = masses[names.index(sheet.fuel)] - burnt
    fuel, fuel_moment = (
        np.append(0.0, x)
        for x in (sheet.fuel_table.mass.of(table, "kg"), sheet.fuel_table.moment.of(table, "kg m"))
    )
    if left.min() < 0.0 or left.max() > fuel[-1]:
        text = (
            f"fuel left is {left.min():.4g} ... {left.max():.4g} kg; the fuel table goes from "
            f"0 to {fuel[-1]:.4g} kg"
        )
        raise SchemaError(
            f"sheet {sheet.file}", [f"{text}; check the unit of the fuel flow and the fuel taken"]
        )
    mass = masses[dry].sum() + left
    station = (moment + np.interp(left, fuel, fuel_moment)) / mass
    return mass, sheet.leading_edge + aircraft.x_ref_mac * aircraft.cbar - station


def deck_thrust(
    deck: ThrustPoints,
    h: np.ndarray,
    mach: np.ndarray,
    temperature: np.ndarray,
    fuel_flow: np.ndarray,
) -> np.ndarray:
    """Return the net thrust of one engine [N] from points of its deck.

    Thrust over pressure ratio is a second-order polynomial of corrected fuel flow and Mach number,
    fitted to the points.

    Raises
    ------
    IdentificationError
        The points are too few, or such a polynomial does not reproduce them.
    """
    points = TestPointSheet(deck.file)
    units = {"h": "m", "mach": "1", "delta_T": "K", "fuel_flow": "kg s-1", "thrust": "N"}
    deck_h, deck_mach, warmer, flow, thrust = (
        getattr(deck, name).of(points, unit) for name, unit in units.items()
    )
    X, delta = _corrected(
        deck_h, deck_mach, np.asarray(atmosphere(deck_h).temperature) + warmer, flow
    )
    if len(X) <= X.shape[1]:
        raise IdentificationError(
            f"{deck.file}: {len(X)} points for {X.shape[1]} coefficients of the thrust; give "
            f"more points"
        )
    theta, _, rank, _ = np.linalg.lstsq(X, thrust / delta)
    rest = float(np.abs(delta * (X @ theta) - thrust).max())
    if rank < X.shape[1] or rest > _RESIDUAL * np.abs(thrust).max():
        text = (
            f"{deck.file}: corrected fuel flow and Mach reproduce the points within "
            f"{rest:.3g} N only"
        )
        raise IdentificationError(f"{text}; check its units, or give thrust in the record")
    X, delta = _corrected(h, mach, temperature, fuel_flow)
    return np.maximum(delta * (X @ theta), 0.0)


def add_computed_mass(
    record: xr.DataTree, aircraft: Aircraft, loading: Loading | None, deck: ThrustPoints | None
) -> xr.DataTree:
    """Return the record with a leaf ``computed``: mass, c.g. and thrust over the clock of the fuel
    flow.

    Raises
    ------
    UnknownName
        A channel that is needed is not in the record.
    SchemaError, IdentificationError
        As `mass_after_burn` and `deck_thrust`.
    """
    if loading is None and deck is None:
        return record
    home = {str(name): leaf for leaf, node in record.children.items() for name in node.data_vars}
    flows = [f"engine{k + 1}.fuel_flow" for k in range(len(aircraft.engines))]
    for name in (*flows, *(_AIR if deck else ())):
        if name not in home:
            raise UnknownName(
                name,
                home,
                "channel",
                "mass and thrust are computed from it; map it, or leave out [loading] and [thrust]",
            )
    clock = record[home[flows[0]]].to_dataset()
    time = clock["time"].values.astype(float)

    def channel(name: str) -> np.ndarray:
        leaf = record[home[name]].to_dataset()
        return np.interp(time, leaf["time"].values, leaf[name].values.astype(float))

    flow = np.array([channel(name) for name in flows])
    found: dict[str, np.ndarray] = {}
    if loading is not None:
        burnt = np.concatenate([[0.0], np.cumsum(flow.sum(axis=0)[:-1] * np.diff(time))])
        found["mass"], found["x_cg_b"] = mass_after_burn(loading, aircraft, burnt)
    if deck is not None:
        h, mach, temperature = (channel(name) for name in _AIR)
        found |= {
            f"engine{k + 1}.thrust": deck_thrust(deck, h, mach, temperature, row)
            for k, row in enumerate(flow)
        }
    data = xr.Dataset(
        {name: ("time", x, quantity_attributes(name)) for name, x in found.items()},
        {"time": clock["time"]},
    )
    return record.assign({"computed": xr.DataTree(data.assign_attrs(clock.attrs))})


def _corrected(h, mach, temperature, fuel_flow) -> tuple[np.ndarray, np.ndarray]:
    """Return the regressors of corrected fuel flow and Mach (point, 6), and the pressure ratio."""
    delta = np.asarray(atmosphere(h).p_static) / P_SEA
    flow = fuel_flow / (delta * np.sqrt(temperature / T_SEA))
    return np.stack([np.ones_like(flow), flow, flow**2, mach, mach * flow, mach**2], axis=1), delta


T = TypeVar("T")
_POINT_RATE = 10.0  # Hz: nothing moves


def evaluate_flight(plan: EvaluationPlan | str | Path) -> Evaluation:
    """Evaluate a flight: consistency, stationary points, coefficients, eigenmotions, each against
    its bounds.

    Parameters
    ----------
    plan : Plan or path
        See `flighttest.flight_programme.evaluation.plan`.

    Returns
    -------
    Evaluation
        A record with errors (`Quality.usable`) is not evaluated any further: numbers from it would
        be wrong without looking so.

    Raises
    ------
    ParseError, SchemaError, UnknownName
        Plan, sheets, name map, aircraft or record are faulty.  A part that the record does not
        carry is no exception but in `refused`.
    """
    plan = plan if isinstance(plan, EvaluationPlan) else read_plan(plan)
    bounds_in_si(plan)
    return _Work(plan).done()


@dataclass
class _Work:
    """An evaluation on its way."""

    plan: EvaluationPlan
    refused: dict[str, str] = field(default_factory=dict)
    paths: dict[str, FlightPath] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.aircraft = read_aircraft(self.plan.aircraft)
        self.record = read(self.plan.record, self.plan.names)
        self.errors = {"thrust": self.plan.thrust.error} if self.plan.thrust else None

    def done(self) -> Evaluation:
        quality = assess(self.record, self.aircraft)
        points, lines, fits, motions = pd.DataFrame(), [], [], {}
        if quality.usable:
            self.record = add_computed_mass(
                self.record, self.aircraft, self.plan.loading, self.plan.thrust
            )
            points = self._points()
            lines = [
                fitted
                for line in self.plan.line
                if (fitted := self._tried(line.name, self._line, line, points)) is not None
            ]
            fits = [
                fit
                for table in self.plan.fit
                if (fit := self._tried(table.name, self._fit, table)) is not None
            ]
            motions = {
                mode.name: m
                for mode in self.plan.mode
                if (m := self._tried(mode.name, self._motion, mode)) is not None
            }
        figures = collect_figures(quality, lines, fits, motions, self.aircraft)
        judged = judge_bounds(self.plan, figures)
        return Evaluation(
            self.plan,
            self.aircraft,
            self.record,
            quality,
            self.paths,
            points,
            lines,
            fits,
            motions,
            figures,
            judged,
            self.refused,
        )

    def _tried(self, name: str, act: Callable[..., T], *items: Any) -> T | None:
        """Return what a part gives, or None after noting why it gives nothing."""
        try:
            return act(*items)
        except AeromatchError as error:
            self.refused[name] = str(error)
            return None

    @cached_property
    def starts(self) -> dict[str, float]:
        table = self.plan.manoeuvres
        if table is None:
            return {}
        sheet = TestPointSheet(table.file)
        return {
            sheet.text(row, table.name): float(t) for row, t in enumerate(table.time.of(sheet, "s"))
        }

    def start(self, name: str) -> float:
        if name not in self.starts:
            raise UnknownName(name, self.starts, "manoeuvre")
        return self.starts[name]

    @cached_property
    def reconstructs(self) -> bool:
        """Whether the record holds accelerations; without them there are means and modes only."""
        return any("ax_imu" in node.data_vars for node in self.record.children.values())

    @cached_property
    def at_points(self) -> xr.Dataset | None:
        """Coefficients along the stationary points, reconstructed together: their speeds determine
        the vane's factor and offset.
        """
        if self.plan.points is None or not self.reconstructs:
            return None
        path = reconstruct(
            self.record,
            self.aircraft,
            series_windows(self.plan.points),
            rate=min(_POINT_RATE, self.plan.rate),
        )
        self.paths["points"] = path
        return coefficients(path, self.aircraft, errors=self.errors)

    def _points(self) -> pd.DataFrame:
        if self.plan.points is None:
            return pd.DataFrame()
        data = self._tried("points", lambda: self.at_points)
        found = self._tried(
            "points",
            window_means,
            self.record,
            self.aircraft,
            series_windows(self.plan.points),
            data,
        )
        return pd.DataFrame() if found is None else found

    def _line(self, line, points: pd.DataFrame) -> FittedLine:
        if points.empty:
            raise SchemaError(f"line {line.name}", ["there are no stationary points"])
        wanted = {start for start, _ in series_windows(self.plan.points, line.series)}  # type: ignore[arg-type]
        return line_through(line, points[points["start"].isin(wanted)])

    def _manoeuvre(self, name: str, window: tuple[float, float]) -> xr.Dataset:
        """Return coefficients along a manoeuvre; the constants of the stationary points are the
        prior of its instruments.
        """
        t = self.start(name)
        points = self.at_points
        prior = self.paths["points"].biases if points is not None else None
        path = reconstruct(
            self.record, self.aircraft, [(t + window[0], t + window[1])], prior, self.plan.rate
        )
        key = name if name not in self.paths else f"{name}_{window[0]:g}_{window[1]:g}"
        self.paths[key] = path
        return coefficients(path, self.aircraft, errors=self.errors)

    @cached_property
    def _flown(self) -> dict[tuple[str, tuple[float, float]], xr.Dataset]:
        return {}

    def _fit(self, table: FitTable) -> Fit:
        if not self.reconstructs:
            raise SchemaError(
                f"fit {table.name}",
                ["no accelerations (ax_imu ay_imu az_imu) in the record; it gives no forces"],
            )
        parts: list[xr.Dataset] = []
        for name in table.on:
            if name == "points":
                data = self.at_points
                parts += (
                    []
                    if data is None
                    else [
                        select_time(data, *w)
                        for w in series_windows(self.plan.points, table.series)  # type: ignore[arg-type]
                    ]
                )
            else:
                key = name, table.window or (0.0, 0.0)
                if key not in self._flown:
                    self._flown[key] = self._manoeuvre(*key)
                parts.append(self._flown[key])
        return regress(RegressionModel.parse(table.model), parts, name=table.name)

    def _motion(self, mode: PlannedMode) -> Motion:
        t = self.start(mode.on)
        home = {str(n): node for node in self.record.children.values() for n in node.data_vars}
        for name in (*mode.channels, *mode.inputs):
            if name not in home:
                raise UnknownName(name, home, "channel", f"mode {mode.name}")
        rate = min(
            self.plan.rate,
            min(float(home[n].attrs["rate"]) for n in (*mode.channels, *mode.inputs)),
        )
        try:
            data = cut(self.record, t + mode.window[0], t + mode.window[1], rate=rate)
        except OutOfRange as error:
            raise OutOfRange(f"mode {mode.name}: {error}") from error
        return fit_motion(data, mode.channels, mode.kind, mode.inputs, mode.trend)
