"""The evaluation of a flight: every part of its plan in order, each part refused by name when the record does not carry it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd
import xarray as xr

from flightmech.aircraft.aircraft import read_aircraft
from flightmech.errors import AeromatchError, OutOfRange, SchemaError, UnknownName

from ..aircraft_properties.eigenmotion import Motion, fit_motion
from ..dynamics.force_coefficients import between, coefficients
from ..equation_error.fit import Fit
from ..equation_error.model import Model
from ..equation_error.time_domain import regress
from ..quality.assessment import assess
from ..reconstruction.smoother import Path as FlightPath
from ..reconstruction.smoother import reconstruct
from ..records.record import read
from ..signals.conditioning import cut
from .figures_of_merit import collect, judge, limits_of
from .mass_and_balance import completed
from .plan import FitTable, Mode, Plan, read_plan
from .result import Evaluation
from .stationary_points import Fitted, line_through, means, windows_of
from .test_point_sheets import Sheet

T = TypeVar("T")
_POINT_RATE = 10.0  # Hz: nothing moves


def evaluate(plan: Plan | str | Path) -> Evaluation:
    """Evaluate a flight: consistency, stationary points, coefficients, eigenmotions, each against its bounds.

    Parameters
    ----------
    plan : Plan or path
        See `flighttest.evaluation.plan`.

    Returns
    -------
    Evaluation
        A record with errors (`Quality.usable`) is not evaluated any further: numbers from it would be wrong without looking so.

    Raises
    ------
    ParseError, SchemaError, UnknownName
        Plan, sheets, name map, aircraft or record are faulty.  A part that the record does not carry is no exception but in `refused`.
    """
    plan = plan if isinstance(plan, Plan) else read_plan(plan)
    limits_of(plan)
    return _Work(plan).done()


@dataclass
class _Work:
    """An evaluation on its way."""

    plan: Plan
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
            self.record = completed(self.record, self.aircraft, self.plan.loading, self.plan.thrust)
            points = self._points()
            lines = [fitted for line in self.plan.line if (fitted := self._tried(line.name, self._line, line, points)) is not None]
            fits = [fit for table in self.plan.fit if (fit := self._tried(table.name, self._fit, table)) is not None]
            motions = {mode.name: m for mode in self.plan.mode if (m := self._tried(mode.name, self._motion, mode)) is not None}
        figures = collect(quality, lines, fits, motions, self.aircraft)
        judged = judge(self.plan, figures)
        return Evaluation(
            self.plan, self.aircraft, self.record, quality, self.paths, points, lines, fits, motions, figures, judged, self.refused
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
        sheet = Sheet(table.file)
        return {sheet.text(row, table.name): float(t) for row, t in enumerate(table.time.of(sheet, "s"))}

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
        """Coefficients along the stationary points, reconstructed together: their speeds determine the vane's factor and offset."""
        if self.plan.points is None or not self.reconstructs:
            return None
        path = reconstruct(self.record, self.aircraft, windows_of(self.plan.points), rate=min(_POINT_RATE, self.plan.rate))
        self.paths["points"] = path
        return coefficients(path, self.aircraft, errors=self.errors)

    def _points(self) -> pd.DataFrame:
        if self.plan.points is None:
            return pd.DataFrame()
        data = self._tried("points", lambda: self.at_points)
        found = self._tried("points", means, self.record, self.aircraft, windows_of(self.plan.points), data)
        return pd.DataFrame() if found is None else found

    def _line(self, line, points: pd.DataFrame) -> Fitted:
        if points.empty:
            raise SchemaError(f"line {line.name}", ["there are no stationary points"])
        wanted = {start for start, _ in windows_of(self.plan.points, line.series)}  # type: ignore[arg-type]
        return line_through(line, points[points["start"].isin(wanted)])

    def _manoeuvre(self, name: str, window: tuple[float, float]) -> xr.Dataset:
        """Return coefficients along a manoeuvre; the constants of the stationary points are the prior of its instruments."""
        t = self.start(name)
        points = self.at_points
        prior = self.paths["points"].biases if points is not None else None
        path = reconstruct(self.record, self.aircraft, [(t + window[0], t + window[1])], prior, self.plan.rate)
        key = name if name not in self.paths else f"{name}_{window[0]:g}_{window[1]:g}"
        self.paths[key] = path
        return coefficients(path, self.aircraft, errors=self.errors)

    @cached_property
    def _flown(self) -> dict[tuple[str, tuple[float, float]], xr.Dataset]:
        return {}

    def _fit(self, table: FitTable) -> Fit:
        if not self.reconstructs:
            raise SchemaError(f"fit {table.name}", ["no accelerations (ax_imu ay_imu az_imu) in the record; it gives no forces"])
        parts: list[xr.Dataset] = []
        for name in table.on:
            if name == "points":
                data = self.at_points
                parts += [] if data is None else [between(data, *w) for w in windows_of(self.plan.points, table.series)]  # type: ignore[arg-type]
            else:
                key = name, table.window or (0.0, 0.0)
                if key not in self._flown:
                    self._flown[key] = self._manoeuvre(*key)
                parts.append(self._flown[key])
        return regress(Model.parse(table.model), parts, name=table.name)

    def _motion(self, mode: Mode) -> Motion:
        t = self.start(mode.on)
        home = {str(n): node for node in self.record.children.values() for n in node.data_vars}
        for name in (*mode.channels, *mode.inputs):
            if name not in home:
                raise UnknownName(name, home, "channel", f"mode {mode.name}")
        rate = min(self.plan.rate, min(float(home[n].attrs["rate"]) for n in (*mode.channels, *mode.inputs)))
        try:
            data = cut(self.record, t + mode.window[0], t + mode.window[1], rate=rate)
        except OutOfRange as error:
            raise OutOfRange(f"mode {mode.name}: {error}") from error
        return fit_motion(data, mode.channels, mode.kind, mode.inputs, mode.trend)
