"""Unit of the fuel flow: against the fuel that left the aircraft, and against the engine's tables.

A flow in lb/h that was taken as kg/h is 2.2 times too large.  No engine burns so much more or less
than its tables, and the fuel that is burned leaves the aircraft.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flightmech.air import P_SEA, T_SEA
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.engine import Engine, list_leaves
from flightmech.terms import evaluate_term
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.declarations.air_temperature import first_coefficient
from flighttest.reconstruction.quality.finding import Finding
from flighttest.regression.uncertainty.jackknife import block_jackknife

_POUNDS = 2.2046226  # lb in a kilogram
_NEAR = 0.15  # of the ratio of the units, within which the unit explains the flow
_TANKS = {"fuel": -1.0, "fuel_used": 1.0, "mass": -1.0}  # sign of their change over the fuel burned
_KNOWN = 0.1  # largest standard error of the fuel that left over the fuel burned
_BLOCKS = 8  # of the jackknife
_FEWEST = 50  # samples
_ROW = ("fuel_flow", "unit of the fuel flow")

Unchecked = list[tuple[str, str, tuple[str, ...], str]]


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
    findings: list[Finding] = []
    if len(names) == len(aircraft.engines):
        for tank in _TANKS:
            ratio = _burned_over_lost(signals, names, tank)
            if ratio is None:
                continue
            # the first quantity that shows the fuel decides
            cause = f"the flow of all engines adds up to {ratio:.3g} of the change of {tank}"
            return _unit_findings(ratio, tuple(names), cause), []
    open_names = []
    for number, engine in enumerate(aircraft.engines, 1):
        name = f"engine{number}.fuel_flow"
        if name not in names:
            continue
        ratio = _recorded_over_table(signals, engine, number)
        if ratio is None:
            open_names.append(name)
        else:
            cause = f"it is {ratio:.3g} of the flow that the tables of the aircraft file give"
            findings += _unit_findings(ratio, (name,), cause)
    if not open_names:
        return findings, []
    reason = (
        "the fuel on board does not change clearly (mass, fuel or fuel_used), and the aircraft "
        "file has no table of fuel flow over recorded channels: compare it with the instruments"
    )
    return findings, [(*_ROW, tuple(open_names), reason)]


def _unit_findings(ratio: float, names: tuple[str, ...], cause: str) -> list[Finding]:
    """Return the error of a flow whose ratio to the expected one is that of two units."""
    for wrong, right, factor in (("lb/h", "kg/h", _POUNDS), ("kg/h", "lb/h", 1.0 / _POUNDS)):
        if abs(ratio / factor - 1.0) < _NEAR:
            text = f"{', '.join(names)}: {wrong} taken as {right}: {cause}"
            remedy = f'give {names[0]} unit = "{wrong}" in the name map'
            evidence = {"ratio": ratio}
            return [Finding("error", "unit", names, text, remedy, evidence=evidence)]
    return []


def _burned_over_lost(signals: ResampledChannels, names: list[str], tank: str) -> float | None:
    """Return the fuel that was burned over the fuel that left; None if nothing shows it.

    The tank is a straight line over the time integral of the flow.
    """
    if tank not in signals or not np.ptp(signals[tank]) > 0.0:
        return None
    good = np.logical_and.reduce([signals.good[name] for name in (tank, *names)])
    if good.sum() < _FEWEST:
        return None
    flow = np.sum([signals[name] for name in names], axis=0)
    burned = np.cumsum(flow) * signals.step
    X = np.stack([burned, np.ones_like(burned)], axis=1)[good]
    y = _TANKS[tank] * signals[tank][good]
    if not np.std(X[:, 0]) > 0.0:
        return None
    lost = first_coefficient(X, y)
    error = block_jackknife(lambda kept: first_coefficient(X[kept], y[kept]), len(y), _BLOCKS)
    if not lost > 0.0 or not float(error) < _KNOWN * lost:
        return None
    return 1.0 / lost


def _recorded_over_table(signals: ResampledChannels, engine: Engine, number: int) -> float | None:
    """Return the recorded flow over that of the tables of an engine; None without such tables."""
    at: dict[str, np.ndarray] = {}
    full = signals.completed(("mach", "p_static", "temperature"))
    for name, values in full.values.items():
        engine_name, _, quantity = name.rpartition(".")
        if engine_name in ("", f"engine{number}"):
            at[quantity] = values
    if {"p_static", "temperature", "mach"} <= set(at):
        temperature = np.maximum(at["temperature"], 1.0)
        at["temperature_ratio"] = temperature / T_SEA * (1.0 + 0.2 * at["mach"] ** 2)
        at["pressure_ratio"] = at["p_static"] / P_SEA
        for name in ("n1", "n2"):
            if name in at:
                at[f"corrected_{name}"] = at[name] / np.sqrt(at["temperature_ratio"])
    if "h" not in at and "h_baro" in at:
        at["h"] = at["h_baro"]
    table = _table_flow(engine, at)
    if table is None:
        return None
    recorded = at["fuel_flow"]
    good = signals.flying & signals.good[f"engine{number}.fuel_flow"] & (table > 0.0)
    # idle: tables are least certain where the flow is least
    good &= table > 0.5 * np.max(table)
    if good.sum() < _FEWEST:
        return None
    return float(np.median(recorded[good] / table[good]))


def _table_flow(engine: Engine, at: Mapping[str, np.ndarray]) -> np.ndarray | None:
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
        return np.broadcast_to(factor * value, at["fuel_flow"].shape).astype(float)
    return None
