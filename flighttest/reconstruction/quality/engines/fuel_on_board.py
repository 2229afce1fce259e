"""Unit of the fuel on board in a record without fuel flow.

Pounds that were taken as kilograms are 2.2 times too many.  The mass of the aircraft falls as much
as its fuel, the engines burn what their tables give, and no tank holds more than its capacity.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flightmech.aircraft.aircraft import Aircraft
from flightmech.units import POUND
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.declarations.air_temperature import first_coefficient
from flighttest.reconstruction.quality.engines.fuel import (
    Unchecked,
    burned_over_lost,
    engine_channels,
    fuel_amounts,
    table_flow,
    with_table_axes,
)
from flighttest.reconstruction.quality.finding import Finding
from flighttest.regression.uncertainty.jackknife import block_jackknife

_TANKS = ("fuel", "fuel_used")
_MOST = 1.05  # of the capacity: a dense fuel, and the rounding of a gauge
_USUAL = (0.7, 1.4)  # fuel over that of the mass or of the tables
_NEAR = 0.1  # of a ratio to that of pounds and kilograms
_KNOWN, _SIGMAS = 0.1, 2.0  # largest standard error of a ratio, and standard errors on it
_BLOCKS, _FEWEST = 8, 50  # of the jackknife; samples
_ROW = ("fuel", "unit of the fuel on board")


def fuel_on_board_findings(
    signals: ResampledChannels, aircraft: Aircraft
) -> tuple[list[Finding], Unchecked]:
    """Return the warnings on fuel in another unit, and what was not checked.

    Parameters
    ----------
    signals : ResampledChannels
        ``fuel`` and ``fuel_used`` [kg]. With the fuel flow of an engine `fuel_findings` checks
        them, and nothing is returned.
    aircraft : Aircraft
        Its tanks have a capacity [kg], its engines tables of fuel flow.
    """
    tanks = [name for name in _TANKS if name in signals]
    if not tanks or any(name.endswith(".fuel_flow") for name in signals.values):
        return [], []
    findings: list[Finding] = []
    unknown = []
    for tank in tanks:
        full = _over_capacity(signals, aircraft) if tank == "fuel" else None
        ratios = list(_ratios(signals, aircraft, tank))
        unusual = [ratio for ratio in ratios if not _is_usual(*ratio[1:])]
        if full is None and not ratios:
            unknown.append(tank)
        elif full is not None or unusual:
            findings.append(_finding(tank, full, unusual))
    if not unknown:
        return findings, []
    reason = (
        "neither the mass, nor the tables of fuel flow, nor a capacity of the tanks shows it: "
        "compare it with the gauges"
    )
    return findings, [(*_ROW, tuple(unknown), reason)]


def _over_capacity(signals: ResampledChannels, aircraft: Aircraft) -> float | None:
    """Return the fuel over the capacity of all tanks if it is larger; None otherwise."""
    tanks = aircraft.fuel.tanks if aircraft.fuel is not None else ()
    capacity = sum(tank.capacity for tank in tanks)
    recorded = signals["fuel"][signals.good["fuel"]]
    if not capacity > 0.0 or not recorded.size:
        return None
    share = float(np.median(recorded)) / capacity
    return share if share > _MOST else None


def _ratios(
    signals: ResampledChannels, aircraft: Aircraft, tank: str
) -> Iterator[tuple[str, float, float]]:
    """Yield what shows the fuel, the change of a tank over it, and its standard error."""
    if "mass" in signals:
        of_mass = _change_over_mass(signals, tank)
        if of_mass is not None:
            yield "the change of mass", *of_mass
    flown = with_table_axes(signals)
    flows: dict[str, np.ndarray] = {}
    for number, engine in enumerate(aircraft.engines, 1):
        flow = table_flow(engine, engine_channels(flown, number))
        if flow is None:
            return
        flows[f"engine{number}.fuel_flow"] = flow
    if not flows:
        return
    everywhere = {name: signals.flying for name in flows}
    burning = ResampledChannels(
        signals.time,
        {**signals.values, **flows},
        good={**signals.good, **everywhere},
        flying=signals.flying,
        step=signals.step,
    )
    amount = fuel_amounts(signals, aircraft)[tank]
    found = burned_over_lost(burning, list(flows), tank, amount)
    if found is not None:
        yield (
            "the fuel that the tables of the engines burn",
            1.0 / found.value,
            found.stderr / found.value**2,
        )


def _change_over_mass(signals: ResampledChannels, tank: str) -> tuple[float, float] | None:
    """Return the change of a tank over that of the mass, with its standard error."""
    good = signals.good[tank] & signals.good["mass"] & signals.flying
    sign = 1.0 if tank == "fuel" else -1.0
    x, y = signals["mass"][good], sign * signals[tank][good]
    if good.sum() < _FEWEST or not np.ptp(x) > 0.0:
        return None
    X = np.stack([x, np.ones_like(x)], axis=1)
    slope = first_coefficient(X, y)
    error = float(
        block_jackknife(lambda rows: first_coefficient(X[rows], y[rows]), len(y), _BLOCKS)
    )
    # a mass that is computed without the gauge does not follow it
    if not slope > 0.0 or not error < _KNOWN * slope:
        return None
    return slope, error


def _is_usual(ratio: float, stderr: float) -> bool:
    margin = _SIGMAS * stderr
    return _USUAL[0] - margin < ratio < _USUAL[1] + margin


def _finding(tank: str, full: float | None, unusual: list[tuple[str, float, float]]) -> Finding:
    """Return the warning on a tank of another unit or scale."""
    texts = []
    evidence = {}
    factors = []
    if full is not None:
        texts.append(f"{full:.3g} times the capacity of the tanks of the aircraft file")
        evidence["capacity"] = full
    for reference, ratio, stderr in unusual:
        texts.append(f"its change is {ratio:.3g} times {reference} (standard error {stderr:.2g})")
        evidence["ratio"] = ratio
        factors.append(ratio)
    kind, cause = "scale", ""
    remedy = f"compare {tank} with the gauges; correct unit or column in the name map"
    for unit, taken, factor in (("lb", "kg", 1.0 / POUND), ("kg", "lb", POUND)):
        if factors and all(abs(ratio / factor - 1.0) < _NEAR for ratio in factors):
            kind, cause = "unit", f": {unit} taken as {taken}"
            remedy = f'give {tank} unit = "{unit}" in the name map'
    if not cause and not factors:
        cause = ": it is in another unit, such as lb or litres taken as kg, or a tank is missing"
    text = f"{tank} is {texts[0]}" if full is not None else f"{tank}: {texts[0]}"
    text = "; ".join([text, *texts[1:]]) + cause
    return Finding("warning", kind, (tank,), text, remedy, evidence=evidence)
