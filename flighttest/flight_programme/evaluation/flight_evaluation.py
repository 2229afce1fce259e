"""Evaluation of a flight by its plan: consistency, stationary points, coefficients, eigenmotions.

A part of the plan that the record does not determine is refused by name; the other parts are
evaluated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd
import xarray as xr

from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import AeromatchError, OutOfRange, SchemaError, UnknownName
from flighttest.flight_programme.evaluation.figures_of_merit import (
    FittedLine,
    bounds_in_si,
    collect_figures,
    judge_bounds,
    line_through,
    series_windows,
    window_means,
)
from flighttest.flight_programme.evaluation.mass_and_thrust import add_computed_mass, thrust_remarks
from flighttest.flight_programme.evaluation.plan import (
    EvaluationPlan,
    FitTable,
    PlannedMode,
    StationaryTimes,
    StraightLine,
    read_plan,
    read_sheet,
)
from flighttest.flight_programme.evaluation.result import Evaluation
from flighttest.reconstruction.dynamics.force_coefficients import coefficients, select_time
from flighttest.reconstruction.flight_path import FlightPath
from flighttest.reconstruction.quality.assessment import assess
from flighttest.reconstruction.smoother import reconstruct
from flighttest.records.record import channel_leaves, read
from flighttest.records.signals.conditioning import cut
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.remarks import Remark, is_forbidden
from flighttest.submodels.aircraft_properties.eigenmotion import Eigenmotion, fit_motion

T = TypeVar("T")
# Largest rate of the reconstruction at stationary points [Hz]; the motion there is slow.
_POINT_RATE = 10.0


def evaluate_flight(plan: EvaluationPlan | str | Path) -> Evaluation:
    """Evaluate a flight: consistency, stationary points, coefficients, eigenmotions and bounds.

    Parameters
    ----------
    plan : EvaluationPlan or path
        See `flighttest.flight_programme.evaluation.plan`.

    Returns
    -------
    Evaluation
        Only the quality is evaluated if the record has errors (`Quality.usable`).  Other numbers
        would be wrong without a visible sign.

    Raises
    ------
    ParseError, SchemaError, UnknownName
        Plan, sheets, name map, aircraft or record are faulty.  A part that the record does not
        determine raises no exception; it is in `refused`.
    """
    if not isinstance(plan, EvaluationPlan):
        plan = read_plan(plan)
    # faults of the bounds are found before the work of the evaluation
    bounds_in_si(plan)
    return _Evaluator(plan).evaluate()


@dataclass
class _Evaluator:
    """Steps of one evaluation, with the results that several parts share."""

    plan: EvaluationPlan
    refused: dict[str, str] = field(default_factory=dict)
    paths: dict[str, FlightPath] = field(default_factory=dict)
    manoeuvre_data: dict[tuple[str, tuple[float, float]], xr.Dataset] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.aircraft = read_aircraft(self.plan.aircraft)
        self.record = read(self.plan.record, self.plan.names)
        self.errors: dict[str, float] | None = None
        if self.plan.thrust is not None:
            self.errors = {"thrust": self.plan.thrust.error}

    def evaluate(self) -> Evaluation:
        quality = assess(self.record, self.aircraft)
        extrapolated: list[Remark] = []
        points = pd.DataFrame()
        lines: list[FittedLine] = []
        fits: list[Fit] = []
        motions: dict[str, Eigenmotion] = {}
        if quality.usable:
            self.record = add_computed_mass(
                self.record, self.aircraft, loading=self.plan.loading, deck=self.plan.thrust
            )
            extrapolated = thrust_remarks(
                self.record, self.aircraft, deck=self.plan.thrust, windows=self._thrust_windows()
            )
            points = self._average_points()
            lines = self._fit_lines(points)
            fits = self._fit_models()
            motions = self._fit_motions()
        figures = collect_figures(
            quality, lines, fits=fits, motions=motions, aircraft=self.aircraft
        )
        remarks = {fit.name: fit.remarks for fit in fits}
        remarks |= {name: motion.remarks for name, motion in motions.items()}
        barred = [name for name, items in remarks.items() if is_forbidden(items)]
        return Evaluation(
            plan=self.plan,
            aircraft=self.aircraft,
            record=self.record,
            quality=quality,
            paths=self.paths,
            points=points,
            lines=lines,
            fits=fits,
            motions=motions,
            figures=figures,
            judged=judge_bounds(self.plan, figures, barred),
            refused=self.refused,
            thrust_remarks=extrapolated,
        )

    def _try_part(self, name: str, act: Callable[..., T], *items: Any) -> T | None:
        """Return the result of a part, or None with the reason in `refused`."""
        try:
            return act(*items)
        except AeromatchError as error:
            self.refused[name] = str(error)
            return None

    def _fit_lines(self, points: pd.DataFrame) -> list[FittedLine]:
        lines = [self._try_part(line.name, self._fit_line, line, points) for line in self.plan.line]
        return [line for line in lines if line is not None]

    def _fit_models(self) -> list[Fit]:
        fits = [self._try_part(table.name, self._fit_model, table) for table in self.plan.fit]
        return [fit for fit in fits if fit is not None]

    def _fit_motions(self) -> dict[str, Eigenmotion]:
        motions = {}
        for mode in self.plan.mode:
            motion = self._try_part(mode.name, self._fit_motion, mode)
            if motion is not None:
                motions[mode.name] = motion
        return motions

    @cached_property
    def starts(self) -> dict[str, float]:
        """Noted start times of the manoeuvres by name. [s]"""
        table = self.plan.manoeuvres
        if table is None:
            return {}
        sheet = read_sheet(table.file)
        times = table.time.of(sheet, "s")
        return {sheet.text(row, table.name): float(time) for row, time in enumerate(times)}

    def start(self, name: str) -> float:
        if name not in self.starts:
            raise UnknownName(name, self.starts, "manoeuvre")
        return self.starts[name]

    @cached_property
    def has_forces(self) -> bool:
        """Whether the record has accelerations; without them there are only means and modes."""
        return any("ax_imu" in node.data_vars for node in self.record.children.values())

    @cached_property
    def point_data(self) -> xr.Dataset | None:
        """Coefficients along the stationary points.

        The points are reconstructed together, because their speeds determine factor and offset of
        the vane.
        """
        if self.plan.points is None or not self.has_forces:
            return None
        path = reconstruct(
            self.record,
            self.aircraft,
            series_windows(self.plan.points),
            rate=min(_POINT_RATE, self.plan.rate),
        )
        self.paths["points"] = path
        return coefficients(path, self.aircraft, errors=self.errors)

    def _thrust_windows(self) -> list[tuple[float, float]]:
        """Return start and stop of the stretches whose thrust is used. [s]"""
        windows: list[tuple[float, float]] = []
        if self.plan.points is not None:
            windows += series_windows(self.plan.points)
        for table in self.plan.fit:
            first, last = table.window or (0.0, 0.0)
            for name in table.on:
                # an unknown manoeuvre is refused with its fit
                if name in self.starts:
                    windows.append((self.starts[name] + first, self.starts[name] + last))
        return windows

    def _average_points(self) -> pd.DataFrame:
        if self.plan.points is None:
            return pd.DataFrame()
        data = self._try_part("points", lambda: self.point_data)
        windows = series_windows(self.plan.points)
        average = partial(window_means, self.record, self.aircraft, windows, data)
        means = self._try_part("points", average)
        if means is None:
            return pd.DataFrame()
        return means

    def _times(self) -> StationaryTimes:
        """Return the stationary points of the plan; its validation demands them for its users."""
        assert self.plan.points is not None
        return self.plan.points

    def _fit_line(self, line: StraightLine, points: pd.DataFrame) -> FittedLine:
        if points.empty:
            raise SchemaError(f"line {line.name}", ["there are no stationary points"])
        starts = {start for start, _ in series_windows(self._times(), line.series)}
        return line_through(line, points[points["start"].isin(starts)])

    def _reconstruct_manoeuvre(self, name: str, window: tuple[float, float]) -> xr.Dataset:
        """Return coefficients along a manoeuvre.

        The constants of the stationary points are the prior of its instruments.
        """
        start = self.start(name)
        first, last = start + window[0], start + window[1]
        prior = None
        if self.point_data is not None:
            prior = self.paths["points"].biases
        path = reconstruct(
            self.record, self.aircraft, [(first, last)], prior=prior, rate=self.plan.rate
        )
        # a manoeuvre in several windows has several paths
        key = name
        if key in self.paths:
            key = f"{name}_{window[0]:g}_{window[1]:g}"
        self.paths[key] = path
        return coefficients(path, self.aircraft, errors=self.errors)

    def _fit_model(self, table: FitTable) -> Fit:
        if not self.has_forces:
            raise SchemaError(
                f"fit {table.name}",
                ["no accelerations (ax_imu ay_imu az_imu) in the record; it gives no forces"],
            )
        parts: list[xr.Dataset] = []
        for name in table.on:
            if name == "points":
                parts += self._point_parts(table.series)
            else:
                parts.append(self._manoeuvre_part(name, table.window or (0.0, 0.0)))
        return regress(RegressionModel.parse(table.model), parts, name=table.name)

    def _point_parts(self, series: tuple[str, ...]) -> list[xr.Dataset]:
        data = self.point_data
        if data is None:
            return []
        return [select_time(data, *window) for window in series_windows(self._times(), series)]

    def _manoeuvre_part(self, name: str, window: tuple[float, float]) -> xr.Dataset:
        """Return coefficients along a manoeuvre, reconstructed once for all fits."""
        if (name, window) not in self.manoeuvre_data:
            self.manoeuvre_data[name, window] = self._reconstruct_manoeuvre(name, window)
        return self.manoeuvre_data[name, window]

    def _fit_motion(self, mode: PlannedMode) -> Eigenmotion:
        start = self.start(mode.on)
        leaves = channel_leaves(self.record)
        names = (*mode.channels, *mode.inputs)
        for name in names:
            if name not in leaves:
                raise UnknownName(name, leaves, "channel", f"mode {mode.name}")
        # the slowest channel limits the rate
        rates = [float(self.record[leaves[name]].attrs["rate"]) for name in names]
        rate = min(self.plan.rate, *rates)
        first, last = start + mode.window[0], start + mode.window[1]
        try:
            data = cut(self.record, first, last, rate=rate)
        except OutOfRange as error:
            raise OutOfRange(f"mode {mode.name}: {error}") from error
        return fit_motion(data, mode.channels, kind=mode.kind, inputs=mode.inputs, trend=mode.trend)
