"""The evaluation of a flight: every part of its plan in order, each part refused by name when the record does not carry it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import pandas as pd
import xarray as xr

from flightmech.aircraft import read_aircraft
from flightmech.console import plain
from flightmech.errors import AeromatchError, OutOfRange, SchemaError, UnknownName
from flightmech.whole import written_whole

from ..conditioning import cut
from ..eigenmotion import Motion, fit_motion
from ..files import save_path, save_record
from ..fit import Fit, save_fit
from ..model import Model
from ..quality.assessment import Quality, assess
from ..reconstruction import Path as FlightPath
from ..reconstruction import reconstruct
from ..record import read
from ..reduction import between, coefficients
from ..regression import regress
from ..remarks import Remark, barred, documents
from .figures import INSIDE, Figure, collect, judge, limits_of
from .plan import FitTable, Mode, Plan, read_plan
from .points import Fitted, line_through, means, windows_of
from .sheets import Sheet
from .weighing import completed

if TYPE_CHECKING:
    from flightmech import Aircraft

T = TypeVar("T")
_ODD = re.compile(r"[^\w.-]+")  # what no name of a file should hold
_POINT_RATE = 10.0  # Hz: nothing moves


@dataclass(frozen=True)
class Evaluation:
    """What `evaluate` found.

    Attributes
    ----------
    plan : Plan
    aircraft : Aircraft
    record : DataTree
        With mass, c.g. and thrust.
    quality : Quality
    paths : dict of str to Path
        ``points``, and one path per manoeuvre and window.
    points : DataFrame
        Means over the stationary points.
    lines : list of Fitted
    fits : list of Fit
    motions : dict of str to Motion
    figures : dict of str to Figure
    judged : DataFrame
        Bounds and verdicts.
    refused : dict of str to str
        What could not be determined, and why.
    """

    plan: Plan
    aircraft: Aircraft
    record: xr.DataTree
    quality: Quality
    paths: dict[str, FlightPath]
    points: pd.DataFrame
    lines: list[Fitted]
    fits: list[Fit]
    motions: dict[str, Motion]
    figures: dict[str, Figure]
    judged: pd.DataFrame
    refused: dict[str, str]

    @property
    def passed(self) -> bool:
        """Whether the record is sound, everything was determined, no remark bars a figure, and every bound holds."""
        return self.quality.usable and not self.refused and not self.barred and bool((self.judged["verdict"] == INSIDE).all())

    @property
    def remarks(self) -> dict[str, list[Remark]]:
        """Remarks on each fit and motion by name."""
        return {fit.name: fit.remarks for fit in self.fits} | {name: motion.remarks for name, motion in self.motions.items()}

    @property
    def barred(self) -> dict[str, list[Remark]]:
        """Fits and motions whose figures must not be used, with the remarks that say why."""
        return {name: remarks for name, remarks in self.remarks.items() if barred(remarks)}

    @property
    def verdict(self) -> str:
        """The whole in one line."""
        if not self.quality.usable:
            return f"not evaluated: the record is not fit for it ({self.quality.verdict})"
        count = int((self.judged["verdict"] == INSIDE).sum())
        refused = f"; not determined: {', '.join(self.refused)}" if self.refused else ""
        unusable = f"; not to be used: {', '.join(self.barred)}" if self.barred else ""
        return f"{count} of {len(self.judged)} figures inside their bounds{refused}{unusable}"

    def report(self) -> str:
        """Return quality, fits, motions and bounds as text."""
        from .words import report

        return report(self)

    def as_dict(self) -> dict[str, Any]:
        """Return everything but the time histories, made of types that JSON knows."""
        figures = {name: figure._asdict() for name, figure in self.figures.items()}
        parts = {"title": self.plan.title, "verdict": self.verdict, "figures": figures, "bounds": self.judged, "refused": self.refused}
        remarks = {name: documents(found) for name, found in self.remarks.items()}
        return plain({**parts, "remarks": remarks, "points": self.points, "quality": self.quality.as_dict()})

    def write_page(self, path: str | Path) -> None:
        """Write one self-contained HTML page, whole or not at all."""
        from .page import page

        with written_whole(path) as part:
            part.write_text(page(self), encoding="utf-8")

    def save(self, folder: str | Path) -> list[Path]:
        """Write record, paths and fits as netCDF files, for the other verbs; return their names."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        files = [folder / "record.nc"]
        save_record(self.record, files[0])
        for name, path in self.paths.items():
            files.append(folder / f"path_{_ODD.sub('_', name)}.nc")
            save_path(path, files[-1])
        for fit in self.fits:
            files.append(folder / f"fit_{fit.name}.nc")
            save_fit(fit, files[-1])
        return files


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
        """Coefficients along the stationary points, reconstructed together: their speeds tell the vane's factor and offset."""
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
            raise SchemaError(f"fit {table.name}", ["no accelerations (ax_imu ay_imu az_imu) in the record; it tells no forces"])
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
