"""Whether a flight, its inputs and a model that passes agree: size and time of the inputs, and lift.

A wrong gain of a pick-up, inputs that are recorded late, or a wrong mass can be within every
tolerance.  They show by their form.  The probe gives the change S(t) of the answer per relative
change of the inputs, so to first order

    flight - model = (g - 1) S(t) - tau S'(t) + offset + drift

where g is the size of the effective over the recorded inputs, and tau their delay.  The lift that
the flight needs, from specific force, mass and thrust, over that of the model's tables at the
recorded flight variables has no parameter at all.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import xarray as xr

from aerodb.store.overview import FREE_AIR
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import Simulation
from flightmech.support.arrays import rms
from pom.judging.beyond_the_bands import SLOWEST
from pom.probing.input_probe import SCALE, SIZES
from pom.tolerances.bands import RowRemark

CHANNELS = ("p", "q", "r", "phi", "theta", "alpha", "beta", "nz")
EXPLAINED = 0.7
"""Share of the difference that size and delay must explain, for a wrong size to be named."""
EXPLAINED_BY_DELAY = 0.6
"""The same for a delay, whose first-order form is less exact."""
GAIN = 0.08
"""Error of the size of the inputs from which on it is named.

No honest model of the T-37 and the C182 with recorded surfaces reaches `EXPLAINED`; the nearest has
0.65.  A pick-up gain wrong by 15 % gives 0.13 to 0.14, and explains 0.89 to 0.97.
"""
GAIN_OF_FORCES = 0.15
"""The same for recorded forces and travel: friction of the circuits is not linear (up to 0.13)."""
DELAY = 0.1
"""Delay of the inputs from which on it is named. [s]

A shift by 0.2 s gives 0.16 to 0.19 s and explains 0.73 to 0.95.  Honest models that reach
`EXPLAINED_BY_DELAY` have at most 0.056 s.
"""
LIFT = 0.06
"""Relative difference of the lift from which on it is named.

Honest models have at most 0.045 (T-37) and 0.022 (C182); a mass wrong by 10 % gives 0.096 to 0.107.
"""
LEAST_LIFT = 0.1  # coefficient below which the ratio of two lifts has no meaning
LEAST_SAMPLES = 50

Traces = Mapping[str, np.ndarray]


# Largest change of the inputs [1], a reversed sign included, and largest delay [s] of a pick-up.
# Beyond them the fit explains another difference: a taxi circle had -19 times and 68 s.
_MOST_GAIN, _MOST_DELAY = 2.5, 1.0


def compare_inputs(
    time: np.ndarray, before: Traces, after: Traces, flight: Traces, *, surfaces: bool
) -> tuple[RowRemark, ...]:
    """Return the remark on size and delay of the inputs, of kind ``departure`` or ``probe``.

    Parameters
    ----------
    time : array (time,)
        [s]
    before, after : mapping of str to array (time,)
        Outputs of the flight of the model as recorded, and with inputs scaled by `SCALE`. [SI]
    flight : mapping of str to array (time,)
        [SI]
    surfaces : bool
        Whether the recorded surfaces drive the model.
    """
    columns: list[np.ndarray] = []
    differences: list[np.ndarray] = []
    position = (time - time.mean()) / max(float(np.ptp(time)), 1e-9)
    # offset and drift come from trim, wind and instruments
    nuisance = np.linalg.qr(np.column_stack([np.ones_like(time), position]))[0]
    for name in CHANNELS:
        if name not in before or name not in after or name not in flight:
            continue
        S = (before[name] - after[name]) / (1.0 - SCALE)
        X = np.column_stack([S, -np.gradient(S, time)])
        z = flight[name] - before[name]
        if not (np.isfinite(X).all() and np.isfinite(z).all()) or rms(S) < SIZES[name]:
            continue
        columns.append((X - nuisance @ (nuisance.T @ X)) / SIZES[name])
        differences.append((z - nuisance @ (nuisance.T @ z)) / SIZES[name])
    if not columns:
        return ()
    X, z = np.concatenate(columns), np.concatenate(differences)
    theta, *_ = np.linalg.lstsq(X, z, rcond=None)
    total = float(z @ z)
    explained = 1.0 - float(np.sum((z - X @ theta) ** 2)) / total if total else 0.0
    # the flight lags for inputs that act late: a record of late inputs gives a negative delay
    gain, delay = 1.0 + float(theta[0]), float(theta[1])
    text = (
        f"the flight fits best with inputs of {gain:.2f} times the recorded size, "
        f"{abs(1e3 * delay):.0f} ms {'later' if delay > 0.0 else 'earlier'}; that explains "
        f"{100 * max(explained, 0.0):.0f} % of the difference"
    )
    values = {"gain": gain, "explained": explained}
    least = GAIN if surfaces else GAIN_OF_FORCES
    is_scaled = explained >= EXPLAINED and abs(gain - 1.0) >= least
    is_late = explained >= EXPLAINED_BY_DELAY and abs(delay) >= DELAY
    # Both are small changes of a linear answer; larger ones are differences of another kind.
    is_linear = abs(gain - 1.0) <= _MOST_GAIN and abs(delay) <= _MOST_DELAY
    if not is_linear:
        text = "not checked: the difference is not one of size and time of the inputs"
        return (RowRemark("probe", text, values={"explained": explained}, unit="1"),)
    if not is_scaled and not is_late:
        return (RowRemark("probe", text, values=values, unit="1"),)
    reason = (
        f"departure: {text}. Check gain and time of the pick-ups (delta_e, delta_a, delta_r or the "
        f"forces), and the effectiveness of the controls of the model"
    )
    return (RowRemark("departure", reason, "inputs", values=values, unit="1"),)


def compare_lift(model: SimModel, states: xr.Dataset) -> tuple[RowRemark, ...]:
    """Return the remark on the lift of flight and model, of kind ``departure`` or ``probe``.

    Parameters
    ----------
    model : SimModel
        With force axes that have a lift.
    states : Dataset (time)
        Of the flight.  Samples on the wheels do not count. [SI]

    Returns
    -------
    tuple of RowRemark
        Empty if the model has no lift in its tables or the flight lacks a quantity.
    """
    count = states.sizes["time"]
    needed = ("ax", "az", "alpha", "qbar", "mass", "V")
    terms = [k for k, name in enumerate(model.terms) if name.startswith("CL/")]
    area = model.meta.get("database", {}).get("S")
    if not terms or area is None or any(name not in states for name in needed):
        return ()

    def channel(name: str) -> np.ndarray:
        return np.broadcast_to(states[name].values.astype(float), count)

    columns = np.zeros((count, len(model.variables)))
    for k, name in enumerate(model.variables):
        if name in states:
            columns[:, k] = channel(name)
        elif name == "h_agl":
            columns[:, k] = FREE_AIR
    expected = Simulation(model.model).evaluate(columns)[1][:, terms].sum(axis=1)
    # specific force less thrust, along the lift
    engines = [str(name) for name in states.data_vars if str(name).endswith(".thrust")]
    mass, alpha = channel("mass"), channel("alpha")
    ax = channel("ax") - sum(channel(name) for name in engines) / mass
    force = mass * (ax * np.sin(alpha) - channel("az") * np.cos(alpha))
    measured = force / (channel("qbar") * float(area))
    is_flying = (channel("V") > SLOWEST) & (np.abs(expected) > LEAST_LIFT)
    for name in map(str, states.data_vars):
        if name.startswith("wow"):
            is_flying &= channel(name) < 0.5
    ratio = np.divide(measured, expected, out=np.full(count, np.nan), where=is_flying)
    ratio = ratio[np.isfinite(ratio)]
    if ratio.size < LEAST_SAMPLES:
        return ()
    middle = float(np.median(ratio))
    text = (
        f"lift: the flight needs {middle:.3f} of what the model has at the recorded angle of attack"
    )
    if math.isfinite(middle) and abs(middle - 1.0) < LIFT:
        return (RowRemark("probe", text, "CL", values={"ratio": middle}, unit="1"),)
    reason = (
        f"departure: {text}. Check mass, angle of attack and airspeed of the record, and the lift "
        f"of the model"
    )
    return (RowRemark("departure", reason, "CL", values={"ratio": middle}, unit="1"),)
