"""Unit of the fuel flow: against the fuel that left the aircraft, and against the engine's tables.

A flow in lb/h that was taken as kg/h is 2.2 times too large.  No engine burns so much more or less
than its tables, and the fuel that is burned leaves the aircraft.  A flow is blamed alone only if
all quantities that show the fuel agree: the fuel on board may be in another unit as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flightmech.air import GAMMA, P_SEA, R_AIR, T_SEA
from flightmech.aircraft.aircraft import Aircraft, tanks_of
from flightmech.aircraft.engine import Engine, list_leaves
from flightmech.terms import evaluate_term
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.declarations.air_temperature import first_coefficient
from flighttest.reconstruction.quality.finding import Finding
from flighttest.regression.uncertainty.jackknife import block_jackknife

_POUNDS = 2.2046226  # lb in a kilogram
_GALLON = (6.0, 6.7)  # lb in a US gallon, from aviation gasoline to Jet A
# unit of the file, unit it was taken as, and the limits of the flow over the true one
_UNITS = (
    ("lb/h", "kg/h", _POUNDS, _POUNDS),
    ("kg/h", "lb/h", 1.0 / _POUNDS, 1.0 / _POUNDS),
    ("kg/min", "kg/s", 60.0, 60.0),
    ("kg/s", "kg/min", 1.0 / 60.0, 1.0 / 60.0),
    ("lb/min", "kg/s", 60.0 * _POUNDS, 60.0 * _POUNDS),
    ("kg/h", "kg/s", 3600.0, 3600.0),
    ("kg/s", "kg/h", 1.0 / 3600.0, 1.0 / 3600.0),
    ("lb/h", "kg/s", 3600.0 * _POUNDS, 3600.0 * _POUNDS),
    ("kg/s", "lb/h", 1.0 / (3600.0 * _POUNDS), 1.0 / (3600.0 * _POUNDS)),
    ("US gal/h", "lb/h", 1.0 / _GALLON[1], 1.0 / _GALLON[0]),
    ("lb/h", "US gal/h", *_GALLON),
    ("US gal/h", "kg/h", _POUNDS / _GALLON[1], _POUNDS / _GALLON[0]),
    ("kg/h", "US gal/h", _GALLON[0] / _POUNDS, _GALLON[1] / _POUNDS),
)
_CERTAIN = 2  # units at the head of the list, which a flow alone in the wrong unit proves
_NEAR = 0.045  # of a ratio, half the way from 2 (two engines or tanks) to the pounds of a kilogram
_USUAL = (0.7, 1.4)  # flow over the fuel that left
_AGREE = 1.3  # largest quotient of two ratios that say the same
_SIGMAS = 2.0  # standard errors on a ratio
_TANKS = {"fuel": -1.0, "fuel_used": 1.0, "mass": -1.0}  # sign of their change over the fuel burned
_TABLES = "tables"
_SUM = "the sum of the tanks"
_KNOWN = 0.1  # largest standard error of the fuel that left over the fuel burned
_BLOCKS = 8  # of the jackknife
_FEWEST = 50  # samples
_ROW = ("fuel_flow", "unit of the fuel flow")

Unchecked = list[tuple[str, str, tuple[str, ...], str]]


class _UnitMistake(NamedTuple):
    """A unit that was taken as another one."""

    recorded: str
    taken: str
    is_certain: bool


class FuelAmount(NamedTuple):
    """What shows the fuel that left."""

    left: np.ndarray  # rises with the fuel that left (time,) [kg]
    recorded: np.ndarray  # where it is recorded (time,)
    channels: tuple[str, ...]


@dataclass(frozen=True)
class _FlowRatio:
    """Recorded flow over the one that a reference shows, with its standard error [1]."""

    reference: str  # a tank, or the tables
    value: float
    stderr: float
    channels: tuple[str, ...] = ()  # of the reference

    @property
    def usual(self) -> bool:
        """Whether the flow agrees with the reference, within the standard error."""
        margin = _SIGMAS * self.stderr
        return _USUAL[0] - margin < self.value < _USUAL[1] + margin

    @property
    def text(self) -> str:
        """The ratio in words."""
        shown = f"{self.value:.3g} (standard error {self.stderr:.2g})"
        if self.reference == _TABLES:
            return f"{shown} times the flow that the tables of the aircraft file give"
        return f"{shown} times the change of {self.reference}"

    def unit(self) -> _UnitMistake | None:
        """Return the mistaken unit that explains the ratio; None if no unit is near."""
        margin = _SIGMAS * self.stderr / self.value
        for place, (wrong, right, low, high) in enumerate(_UNITS):
            nearest = min(max(self.value, low), high)
            if abs(self.value / nearest - 1.0) < _NEAR:
                certain = abs(self.value / nearest - 1.0) + margin < _NEAR
                return _UnitMistake(wrong, right, certain and place < _CERTAIN)
        return None


def fuel_findings(
    signals: ResampledChannels, aircraft: Aircraft
) -> tuple[list[Finding], Unchecked]:
    """Return the findings on the unit of the fuel flow, and what was not checked.

    Parameters
    ----------
    signals : ResampledChannels
        Without mistakes.
    aircraft : Aircraft
        Its engines have tables of fuel flow or of specific consumption.
    """
    names = []
    for number in range(1, len(aircraft.engines) + 1):
        if f"engine{number}.fuel_flow" in signals:
            names.append(f"engine{number}.fuel_flow")
    if not names:
        return [], []
    if len(names) == len(aircraft.engines):
        ratios = []
        for reference, amount in fuel_amounts(signals, aircraft).items():
            ratio = burned_over_lost(signals, names, reference, amount)
            if ratio is not None:
                ratios.append(ratio)
        if ratios:
            return _judge_total(signals, aircraft, names=tuple(names), tanks=ratios), []
    findings: list[Finding] = []
    open_names = []
    for number, engine in enumerate(aircraft.engines, 1):
        name = f"engine{number}.fuel_flow"
        if name not in names:
            continue
        ratio = _recorded_over_table(signals, {number: engine})
        if ratio is None:
            open_names.append(name)
        else:
            findings += _flow_findings(ratio, (name,), len(aircraft.engines))
    if not open_names:
        return findings, []
    reason = (
        "the fuel on board does not change clearly (mass, fuel or fuel_used), and the aircraft "
        "file has no table of fuel flow over recorded channels: compare it with the instruments"
    )
    return findings, [(*_ROW, tuple(open_names), reason)]


def _judge_total(
    signals: ResampledChannels,
    aircraft: Aircraft,
    *,
    names: tuple[str, ...],
    tanks: list[_FlowRatio],
) -> list[Finding]:
    """Return the findings on the flow of all engines against all that shows the fuel."""
    ratios = list(tanks)
    of_tables = _recorded_over_table(signals, dict(enumerate(aircraft.engines, 1)))
    if of_tables is not None:
        ratios.append(of_tables)
    unusual = [ratio for ratio in ratios if not ratio.usual]
    if not unusual:
        return []
    values = [ratio.value for ratio in ratios]
    agree = max(values) < _AGREE * min(values)
    best = min(unusual, key=lambda ratio: ratio.stderr / ratio.value)
    # The mass is checked against the lift, so its unit is known.  That of a gauge is not.
    known = len(ratios) > 1 or best.reference == "mass"
    if agree and known:
        alone = _engine_alone(signals, names, best)
        return [alone] if alone else _flow_findings(best, names, len(aircraft.engines))
    return [_both_sides(ratios, unusual, names, len(aircraft.engines))]


def _engine_alone(
    signals: ResampledChannels, names: tuple[str, ...], ratio: _FlowRatio
) -> Finding | None:
    """Return the finding on one engine alone in lb/h; None if total and engines do not show it."""
    # With one of n flows 2.2 times too large the total is (2.2 + n - 1) / n of the true one.
    total = (_POUNDS + len(names) - 1.0) / len(names)
    if len(names) < 2 or abs(ratio.value / total - 1.0) > _NEAR:
        return None
    flying = np.logical_and.reduce([signals.flying, *(signals.good[name] for name in names)])
    medians = {name: float(np.median(signals[name][flying])) for name in names}
    for name, flow in medians.items():
        others = [medians[other] for other in names if other != name]
        quotient = flow / max(float(np.mean(others)), np.finfo(float).tiny)
        if abs(quotient / _POUNDS - 1.0) < _NEAR:
            text = (
                f"{name} alone: lb/h taken as kg/h: it has {quotient:.3g} times the flow of "
                f"{', '.join(item for item in names if item != name)}, and all together are "
                f"{ratio.text}"
            )
            remedy = f'give {name} unit = "lb/h" in the name map, if both engines had one setting'
            evidence = {"ratio": ratio.value, "stderr": ratio.stderr, "quotient": quotient}
            return Finding("warning", "unit", (name,), text, remedy, evidence=evidence)
    return None


def _flow_findings(ratio: _FlowRatio, names: tuple[str, ...], engines: int) -> list[Finding]:
    """Return the finding on a flow that is not the one of its references; none if it is usual."""
    if ratio.usual:
        return []
    unit = ratio.unit()
    listed = ", ".join(names)
    evidence = {"ratio": ratio.value, "stderr": ratio.stderr}
    if unit is not None and unit.is_certain:
        text = f"{listed}: {unit.recorded} taken as {unit.taken}: the flow is {ratio.text}"
        remedy = f'give {names[0]} unit = "{unit.recorded}" in the name map'
        return [Finding("error", "unit", names, text, remedy, evidence=evidence)]
    text = f"{listed}: the flow is {ratio.text}; {_USUAL[0]:g} to {_USUAL[1]:g} are usual"
    text += _cause_text(ratio, engines)
    remedy = f"compare {listed} with the instruments; correct unit or column in the name map"
    kind = "scale" if unit is None else "unit"
    return [Finding("warning", kind, names, text, remedy, evidence=evidence)]


def _cause_text(ratio: _FlowRatio, engines: int) -> str:
    """Return what explains a ratio: a unit, or a number of engines or tanks; or nothing."""
    unit = ratio.unit()
    if unit is not None:
        return f", as if the flow were in {unit.recorded} and taken as {unit.taken}"
    # a mass holds all tanks
    tank = ratio.reference if ratio.reference in ("fuel", "fuel_used") else ""
    for number in sorted({2, max(engines, 2)}):
        if abs(ratio.value / number - 1.0) < _NEAR:
            cause = f", as if each column held the flow of {number} engines"
            return cause + (f", or {tank} were that of one tank of {number}" if tank else "")
        if abs(ratio.value * number - 1.0) < _NEAR:
            cause = f", as if the columns held 1/{number} of the flow"
            return cause + (f", or {tank} were counted {number} times" if tank else "")
    return ""


def _both_sides(
    ratios: list[_FlowRatio], unusual: list[_FlowRatio], names: tuple[str, ...], engines: int
) -> Finding:
    """Return the warning that the flow, or what shows the fuel, is of another unit or scale."""
    suspects = [ratio.reference for ratio in unusual if ratio.reference != _TABLES]
    trusted = [ratio.reference for ratio in ratios if ratio.usual]
    listed = ", ".join(names)
    shown = "; ".join(ratio.text for ratio in ratios)
    others = ", ".join(suspects) or "the tables of the aircraft file"
    text = f"{listed} and {others} do not agree: the flow is {shown}"
    text += _cause_text(unusual[0], engines)
    unit = unusual[0].unit()
    kind = "scale" if unit is None else "unit"
    # the inverse error of the tank gives the same ratio
    if suspects and unit is not None and unit.is_certain:
        of_tank, taken = unit.taken.partition("/")[0], unit.recorded.partition("/")[0]
        text += f", or {suspects[0]} in {of_tank} and taken as {taken}"
    if trusted:
        text += f"; the flow agrees with {', '.join(trusted)}"
    remedy = (
        f"compare {', '.join((*suspects, *names))} with the instruments; correct unit or column"
    )
    # a flow that a reference confirms is the lesser suspect
    suspected: list[str] = []
    for ratio in unusual:
        suspected += ratio.channels
    channels = (*suspected, *names) if trusted else (*names, *suspected)
    evidence = {ratio.reference: ratio.value for ratio in ratios}
    return Finding("warning", kind, channels, text, remedy, evidence=evidence)


def fuel_amounts(signals: ResampledChannels, aircraft: Aircraft) -> dict[str, FuelAmount]:
    """Return what shows the fuel that left, by the name of the reference."""
    amounts = {}
    for name, sign in _TANKS.items():
        if name in signals:
            amounts[name] = FuelAmount(sign * signals[name], signals.good[name], (name,))
    contents = [f"tank.{tank.name}.fuel" for tank in tanks_of(aircraft)]
    # pumps and a cross-feed move fuel between the tanks, but not their sum
    if contents and all(name in signals for name in contents):
        total = np.sum([signals[name] for name in contents], axis=0)
        good = np.logical_and.reduce([signals.good[name] for name in contents])
        amounts[_SUM] = FuelAmount(-total, good, tuple(contents))
    return amounts


def burned_over_lost(
    signals: ResampledChannels,
    names: list[str],
    reference: str,
    amount: FuelAmount,
) -> _FlowRatio | None:
    """Return the fuel that was burned over the fuel that left; None if nothing shows it.

    The amount that left is a straight line over the time integral of the flow.
    """
    if not np.ptp(amount.left) > 0.0:
        return None
    good = np.logical_and.reduce([amount.recorded, *(signals.good[name] for name in names)])
    if good.sum() < _FEWEST:
        return None
    flow = np.sum([signals[name] for name in names], axis=0)
    burned = np.cumsum(flow) * signals.step
    X = np.stack([burned, np.ones_like(burned)], axis=1)[good]
    y = amount.left[good]
    if not np.std(X[:, 0]) > 0.0:
        return None
    lost = first_coefficient(X, y)
    error = _stderr(lambda rows: first_coefficient(X[rows], y[rows]), len(y))
    if not lost > 0.0 or not error < _KNOWN * lost:
        return None
    return _FlowRatio(reference, 1.0 / lost, error / lost**2, amount.channels)


def _stderr(estimate: Callable[[np.ndarray], float], samples: int) -> float:
    return float(block_jackknife(estimate, samples, _BLOCKS))


def _recorded_over_table(
    signals: ResampledChannels, engines: Mapping[int, Engine]
) -> _FlowRatio | None:
    """Return the recorded flow of engines over that of their tables; None without such tables."""
    full = with_table_axes(signals)
    recorded, table = np.zeros(signals.time.shape), np.zeros(signals.time.shape)
    good = signals.flying.copy()
    for number, engine in engines.items():
        at = engine_channels(full, number)
        flow = table_flow(engine, at)
        if flow is None:
            return None
        recorded, table = recorded + at["fuel_flow"], table + flow
        good &= signals.good[f"engine{number}.fuel_flow"] & (flow > 0.0)
    # idle: tables are least certain where the flow is least
    good &= table > 0.5 * np.max(table)
    if good.sum() < _FEWEST:
        return None
    quotient = recorded[good] / table[good]
    value = float(np.median(quotient))
    if not value > 0.0:
        return None
    error = _stderr(lambda rows: float(np.median(quotient[rows])), len(quotient))
    return _FlowRatio(_TABLES, value, error)


def with_table_axes(signals: ResampledChannels) -> ResampledChannels:
    """Return signals with the axes of engine tables, formed from what is recorded."""
    return signals.completed(("V", "p_static", "temperature"))


def engine_channels(full: ResampledChannels, number: int) -> dict[str, np.ndarray]:
    """Return the channels of an engine and of the flight by the names of tables, SI."""
    at: dict[str, np.ndarray] = {}
    for name, values in full.values.items():
        engine_name, _, quantity = name.rpartition(".")
        if engine_name in ("", f"engine{number}"):
            at[quantity] = values
    if "mach" not in at and {"V", "temperature"} <= set(at):
        # a record with calibrated airspeed alone has its Mach number from the true one
        at["mach"] = at["V"] / np.sqrt(GAMMA * R_AIR * np.maximum(at["temperature"], 1.0))
    if {"p_static", "temperature", "mach"} <= set(at):
        temperature = np.maximum(at["temperature"], 1.0)
        at["temperature_ratio"] = temperature / T_SEA * (1.0 + 0.2 * at["mach"] ** 2)
        at["pressure_ratio"] = at["p_static"] / P_SEA
        for name in ("n1", "n2"):
            if name in at:
                at[f"corrected_{name}"] = at[name] / np.sqrt(at["temperature_ratio"])
    if "h" not in at and "h_baro" in at:
        at["h"] = at["h_baro"]
    return at


def table_flow(engine: Engine, at: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return the fuel flow of the tables of an engine (time,); None if they need other channels."""
    tables = list_leaves(engine)
    for name in ("fuel_flow", "corrected_fuel_flow", "shaft_bsfc", "bsfc"):
        if name not in tables or not set(map(str, tables[name]["value"].dims)) <= set(at):
            continue
        factor: np.ndarray | float = 1.0
        if name == "corrected_fuel_flow":
            if "pressure_ratio" not in at:
                continue
            factor = at["pressure_ratio"] * np.sqrt(at["temperature_ratio"])
        elif name.endswith("bsfc"):
            if not {"torque", "rpm"} <= set(at):
                continue
            factor = np.maximum(at["torque"] * at["rpm"], 0.0)
        value = evaluate_term(tables[name], at, outside="clamp")
        samples = next(iter(at.values())).shape
        return np.broadcast_to(factor * value, samples).astype(float)
    return None
