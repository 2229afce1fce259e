"""What the evaluation of a flight found, and its text."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import xarray as xr

from flightmech.support.console import plain

from ..aircraft_properties.eigenmotion import Motion
from ..equation_error.fit import Fit, save_fit
from ..quality.result import Quality
from ..quality.result import report as quality_report
from ..reconstruction.path_files import save_path
from ..reconstruction.smoother import Path as FlightPath
from ..records.files import save_record
from ..remarks import Remark, barred, documents
from .figures_of_merit import INSIDE, Figure
from .plan import Plan
from .stationary_points import Fitted
from .text import limits_shown, number, unit_shown

if TYPE_CHECKING:
    from flightmech import Aircraft


_ODD = re.compile(r"[^\w.-]+")  # what no name of a file should hold


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
        """Fits and motions whose figures must not be used, with the remarks that state why."""
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
        return report(self)

    def as_dict(self) -> dict[str, Any]:
        """Return everything but the time histories, made of types that JSON knows."""
        figures = {name: figure._asdict() for name, figure in self.figures.items()}
        parts = {"title": self.plan.title, "verdict": self.verdict, "figures": figures, "bounds": self.judged, "refused": self.refused}
        remarks = {name: documents(found) for name, found in self.remarks.items()}
        return plain({**parts, "remarks": remarks, "points": self.points, "quality": self.quality.as_dict()})

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


def report(evaluation: Evaluation) -> str:
    """Return consistency, stationary lines, coefficients, eigenmotions and bounds as text."""
    e = evaluation
    lines = [e.plan.title, e.verdict, "", quality_report(e.quality), ""]
    for fitted in e.lines:
        head = f"{fitted.line.name}: {fitted.line.y} over {fitted.line.x}, {len(fitted.x)} points"
        lines += [head, *_figures(e, fitted.line.name), ""]
    for fit in e.fits:
        lines += [fit.report(), ""]
    for name, motion in e.motions.items():
        lines += [f"{name}: {motion.report()}", ""]
    for name, text in e.refused.items():
        lines += [f"! {name} not determined: {text}"]
    lines += ["", "bounds:"]
    for row in e.judged.to_dict("records"):
        symbol = " " if row["verdict"] == "inside" else "!"
        value = f"{number(row['value'], row['unit'])} ({number(row['stderr'], row['unit'], 2)}) {unit_shown(row['unit'])}".rstrip()
        limits = limits_shown(row["low"], row["high"], row["unit"])
        lines.append(f"{symbol} {row['of']:34s} {value:28s} {limits:24s} {row['verdict']:15s} {row['source']}")
    return "\n".join(lines)


def _figures(e: Evaluation, name: str) -> list[str]:
    return [
        f"  {key.rpartition('.')[2]:10s}{number(f.value, f.unit):>10s} ({number(f.stderr, f.unit, 2)}) {unit_shown(f.unit)}".rstrip()
        for key, f in e.figures.items()
        if key.rpartition(".")[0] == name
    ]
