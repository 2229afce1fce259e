"""Unit of the torque: the power of the shaft against the charts of the engine.

A torque in lbf ft that was taken as N m is 0.74 of the true one.  The torque of the other side of
a gearbox, or that of both engines, differs by a whole factor.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.engine import Engine, list_leaves
from flightmech.terms import evaluate_term
from flightmech.units import FOOT, INCH, POUND_FORCE
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.engines.fuel import (
    Unchecked,
    engine_channels,
    with_table_axes,
)
from flighttest.reconstruction.quality.finding import Finding
from flighttest.regression.uncertainty.jackknife import block_jackknife

# unit of the file, unit it was taken as, and the torque over the true one
_UNITS = (
    ("lbf ft", "N m", 1.0 / (POUND_FORCE * FOOT)),
    ("N m", "lbf ft", POUND_FORCE * FOOT),
    ("lbf in", "N m", 1.0 / (POUND_FORCE * INCH)),
    ("N m", "lbf in", POUND_FORCE * INCH),
    ("kN m", "N m", 1e-3),
)
_USUAL = (0.82, 1.22)  # torque over that of the charts; 0.96 to 0.98 on the commuter
_NEAR = 0.08  # of a ratio, within which a unit or a gearbox explains it
_KNOWN, _SIGMAS = 0.03, 3.0  # largest standard error of the ratio, and standard errors on it
_BLOCKS, _FEWEST = 8, 50  # of the jackknife; samples
_WORKING = 0.3  # of the largest power of the flight, above which charts are certain
_STOPPED = 0.05  # of the largest power of the charts, below which an engine gives none
_ROW = ("shaft", "size of the torque")


def torque_findings(
    signals: ResampledChannels, aircraft: Aircraft
) -> tuple[list[Finding], Unchecked]:
    """Return the warnings on torques of another unit or shaft, and what was not checked.

    Parameters
    ----------
    signals : ResampledChannels
        ``engine1.torque`` [N m] and ``engine1.rpm`` [rad s-1], and the channels of the charts.
    aircraft : Aircraft
        Its engines have tables of shaft power.
    """
    findings: list[Finding] = []
    unknown = []
    for number, engine in enumerate(aircraft.engines, 1):
        name = f"engine{number}.torque"
        if engine.propeller is None or name not in signals:
            continue
        ratio = _torque_over_charts(signals, engine, number)
        if ratio is None:
            unknown.append(name)
            continue
        value, error = ratio
        margin = _SIGMAS * error
        if not _USUAL[0] - margin < value < _USUAL[1] + margin:
            findings.append(_finding(name, value, error, aircraft=aircraft, engine=engine))
    if not unknown:
        return findings, []
    reason = (
        "the record has no stretch at power with all channels of a chart of shaft power: flight "
        "engine compares it with charts"
    )
    return findings, [(*_ROW, tuple(sorted(unknown)), reason)]


def _torque_over_charts(
    signals: ResampledChannels, engine: Engine, number: int
) -> tuple[float, float] | None:
    """Return the median of torque times speed over the power of the charts, and its error.

    None if the charts need other channels, or if the ratio scatters.
    """
    full = with_table_axes(signals)
    at = engine_channels(full, number)
    charts = _chart_power(engine, at)
    if charts is None or "rpm" not in at:
        return None
    power, most = charts
    names = [name for name in full.good if name.rpartition(".")[0] in ("", f"engine{number}")]
    used = [name for name in names if name.endswith((".torque", ".rpm"))]
    good = signals.flying & np.isfinite(power)
    for name in used:
        good &= full.good[name]
    # near idle charts and torque are small differences
    largest = np.max(power[good], initial=0.0)
    good &= power > max(_WORKING * largest, _STOPPED * most)
    if good.sum() < _FEWEST:
        return None
    quotient = at["torque"][good] * at["rpm"][good] / power[good]
    value = float(np.median(quotient))
    error = float(
        block_jackknife(lambda rows: float(np.median(quotient[rows])), len(quotient), _BLOCKS)
    )
    if not value > 0.0 or not error < _KNOWN * value:
        return None
    return value, error


def _chart_power(engine: Engine, at: Mapping[str, np.ndarray]) -> tuple[np.ndarray, float] | None:
    """Return the shaft power of the charts of an engine (time,), and their largest one. [W]

    None without a chart, or without one of its axes.
    """
    tables = list_leaves(engine)
    for name in ("shaft_power", "corrected_shaft_power"):
        if name not in tables or not set(map(str, tables[name].variables["value"].dims)) <= set(at):
            continue
        factor: np.ndarray | float = 1.0
        if name == "corrected_shaft_power":
            if "pressure_ratio" not in at:
                continue
            factor = at["pressure_ratio"] * np.sqrt(at["temperature_ratio"])
        value = evaluate_term(tables[name], at, outside="clamp")
        power = np.broadcast_to(factor * value, at["torque"].shape).astype(float)
        return power, float(tables[name].variables["value"].values.max())
    return None


def _finding(
    name: str, value: float, error: float, *, aircraft: Aircraft, engine: Engine
) -> Finding:
    """Return the warning on a torque that is not that of the charts."""
    text = (
        f"{name} times the speed of the shaft is {value:.3g} times the power of the charts of the "
        f"aircraft file (standard error {error:.2g}); {_USUAL[0]:g} to {_USUAL[1]:g} are usual"
    )
    remedy = f"compare {name} with the instruments; correct unit or column in the name map"
    kind = "scale"
    causes = []
    for recorded, taken, factor in _UNITS:
        if abs(value / factor - 1.0) < _NEAR:
            kind = "unit"
            causes.append(f"{recorded} taken as {taken}")
            remedy = f'give {name} unit = "{recorded}" in the name map, if the gauge has that unit'
    causes += _other_shafts(value, engine, len(aircraft.engines))
    if causes:
        text += f": as of {', or of '.join(causes)}"
    evidence = {"ratio": value, "stderr": error}
    return Finding("warning", kind, (name,), text, remedy, evidence=evidence)


def _other_shafts(value: float, engine: Engine, engines: int) -> list[str]:
    """Return which torque of another shaft, or of several engines, has a ratio to the right one."""
    causes = []
    ratio = float(engine.propeller.gear_ratio) if engine.propeller is not None else 1.0
    if ratio > 1.0 + _NEAR and abs(value * ratio - 1.0) < _NEAR:
        causes.append(f"a torque in front of the gearbox, which turns {ratio:.4g} times as fast")
    for count in sorted({2, engines} - {1}):
        if abs(value / count - 1.0) < _NEAR:
            causes.append(f"a torque, or charts, of {count} engines in place of one")
        if abs(value * count - 1.0) < _NEAR:
            causes.append(f"charts of {count} engines in place of one")
    return causes
