"""Whether a flight, its inputs and a model that passes agree: size and time of inputs, and lift.

A wrong gain of a pick-up, inputs that are recorded late, or a wrong mass can be within every
tolerance.  They show by their form.  The probe gives the change S(t) of the answer per relative
change of the inputs, so to first order

    flight - model = (g - 1) S(t) - tau S'(t) + offset + drift

where g is the size of the effective over the recorded inputs, and tau their delay.  The lift that
the flight needs, from specific force, mass and thrust, over that of the model's tables at the
recorded flight variables has no parameter at all.  Its slope does not depend on an offset of the
angle of attack either.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping

import numpy as np
import xarray as xr

from aerodb.store.overview import FREE_AIR
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import Simulation
from flightmech.support.arrays import rms
from flighttest.regression.uncertainty.jackknife import block_jackknife
from pom.cases.reference_states import CALIBRATION
from pom.judging.watched_channels import SLOWEST
from pom.probing.input_probe import SCALE, SIZES
from pom.status import unprobed_remark
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
LEAST_EFFECT = 0.25
"""Effect of size and delay of the inputs that is named, in `SIZES`, of the largest channel.

In a slow manoeuvre a small error of any kind has the form of a delay: the level deceleration of the
T-37 with its levers fits 0.165 s, with an effect of 0.16.  Pick-ups wrong by 15 % or 0.2 s have
0.39 and more.
"""
LIFT = 0.035
"""Relative difference of the lift from which on it is named, with a calibrated vane.

Honest models of the T-37 and the C182 have at most 0.030.  The standard error of the angle of
attack is added: with the vanes of one record alone they have up to 0.045, where that error is
0.035.
"""
UNKNOWN_ANGLE = 0.03
"""What is added where no standard error of the angle of attack is known."""
LIFT_SLOPE = 0.045
"""Relative difference of the slopes of the lift from which on it is named.

An offset of the angle of attack does not change the slope.  Honest models of the T-37 have at most
0.037, in windows with the range and the standard error below.
"""
LEAST_RANGE, MOST_STDERR = 0.05, 0.02  # of the lift coefficient, and of the slope
_STEP = 0.01  # of the angle of attack, for the slope of the model [rad]
_SLOPES = 100  # samples of the slope of the model
_BLOCKS = 8  # of the jackknife of the slope
LIFT_QUANTITY = "CL"  # of the remark on the lift
INPUTS_PROBE = "size and time of the inputs"
"""Name of `compare_inputs` in the remark that it was not made."""
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
    nuisance = _offset_and_drift(time)
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
        return (unprobed_remark(INPUTS_PROBE, "no channel of flight and model responds enough"),)
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
    is_large = max(rms(block @ theta) for block in columns) >= LEAST_EFFECT
    is_scaled = is_large and explained >= EXPLAINED and abs(gain - 1.0) >= least
    is_late = is_large and explained >= EXPLAINED_BY_DELAY and abs(delay) >= DELAY
    # Both are small changes of a linear answer; larger ones are differences of another kind.
    is_linear = abs(gain - 1.0) <= _MOST_GAIN and abs(delay) <= _MOST_DELAY
    if not is_linear:
        reason = "flight and model differ by another form than that of changed inputs"
        return (unprobed_remark(INPUTS_PROBE, reason),)
    if not is_scaled and not is_late:
        return (RowRemark("probe", text, values=values, unit="1"),)
    reason = (
        f"departure: {text}. Check gain and time of the pick-ups (elevator, aileron, rudder or the "
        f"forces), and the effectiveness of the controls of the model"
    )
    return (RowRemark("departure", reason, "inputs", values=values, unit="1"),)


def largest_input_effect(time: np.ndarray, before: Traces, flight: Traces) -> float:
    """Return a bound of the effect that `compare_inputs` can find, in `SIZES`.

    A least-squares fit is never larger than what it fits: the difference of flight and model less
    offset and drift, here over all channels.

    Parameters
    ----------
    time, before, flight
        As `compare_inputs`.
    """
    nuisance = _offset_and_drift(time)
    total = 0.0
    for name in CHANNELS:
        if name not in before or name not in flight:
            continue
        z = flight[name] - before[name]
        if np.isfinite(z).all():
            total += rms((z - nuisance @ (nuisance.T @ z)) / SIZES[name]) ** 2
    return math.sqrt(total)


def _offset_and_drift(time: np.ndarray) -> np.ndarray:
    """Return the orthonormal forms that come from trim, wind and instruments (time, 2)."""
    position = (time - time.mean()) / max(float(np.ptp(time)), 1e-9)
    return np.linalg.qr(np.column_stack([np.ones_like(time), position]))[0]


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
        With the errors of the mass that would not be named, or with what prevents the comparison.
    """
    needed = ("ax", "az", "alpha", "qbar", "mass", "V")
    is_lift = any(name.startswith("CL/") for name in model.terms)
    if not is_lift or model.meta.get("database", {}).get("S") is None:
        return lift_not_checked("the model has no lift in its tables")
    missing = [name for name in needed if name not in states]
    if missing:
        return lift_not_checked(f"the flight has no {', '.join(missing)}")
    measured, expected, share_per_radian = lift_pair(model, states)
    if measured.size < LEAST_SAMPLES:
        return lift_not_checked("the aeroplane does not fly, or has hardly any lift")
    stderr = _angle_error(states)
    shift = UNKNOWN_ANGLE
    if stderr is not None:
        shift = stderr * share_per_radian
    return judge_lift(measured, expected, LIFT + shift)


def _angle_error(states: xr.Dataset) -> float | None:
    """Return the standard error of the offset of the angle of attack; None if not known. [rad]"""
    for row in json.loads(states.attrs.get(CALIBRATION, "[]")):
        if row["parameter"] == "bias.alpha_vane":
            return float(row["stderr"])
    return None


def judge_lift(measured: np.ndarray, expected: np.ndarray, limit: float) -> tuple[RowRemark, ...]:
    """Return the remark of `compare_lift` for lift coefficients of flight and model (sample,)."""
    # a mass that is wrong by a share multiplies both numbers by one plus the share
    tests = {"level": (float(np.median(measured / expected)), limit)}
    if np.ptp(expected) >= LEAST_RANGE:
        slope, stderr = _lift_slope(measured, expected)
        if stderr <= MOST_STDERR:
            tests["slope"] = (slope, LIFT_SLOPE)
    ratio = tests["level"][0]
    text = (
        f"lift: the flight needs {ratio:.3f} of what the model has at the recorded angle of attack"
    )
    values = {"ratio": ratio, "limit": limit}
    if "slope" in tests:
        slope, _ = tests["slope"]
        text += f", and {slope:.3f} of the slope"
        values["slope"] = slope
    if all(abs(value - 1.0) < most for value, most in tests.values()):
        least = max((1.0 - most) / value - 1.0 for value, most in tests.values())
        largest = min((1.0 + most) / value - 1.0 for value, most in tests.values())
        text += (
            f"; an error of the mass between {100 * least:+.1f} % and {100 * largest:+.1f} % "
            f"cannot be seen here"
        )
        return (RowRemark("probe", text, LIFT_QUANTITY, values=values, unit="1"),)
    reason = (
        f"departure: {text}. Check mass, angle of attack and airspeed of the record, and the lift "
        f"of the model"
    )
    return (RowRemark("departure", reason, LIFT_QUANTITY, values=values, unit="1"),)


def _lift_slope(measured: np.ndarray, expected: np.ndarray) -> tuple[float, float]:
    """Return the slope of measured over expected lift, and its standard error by the jackknife."""
    if not np.ptp(expected) > 0.0:
        return math.nan, math.inf

    def fit(x: np.ndarray, y: np.ndarray) -> float:
        x, y = x - x.mean(), y - y.mean()
        return float(x @ y / max(x @ x, 1e-30))

    stderr = block_jackknife(
        lambda kept: fit(expected[kept], measured[kept]), measured.size, _BLOCKS
    )
    return fit(expected, measured), float(stderr)


def lift_not_checked(reason: str) -> tuple[RowRemark, ...]:
    """Return the remark that the lift of the flight was not compared."""
    return (unprobed_remark("the mass, by the lift of the flight", reason, LIFT_QUANTITY),)


def lift_pair(model: SimModel, states: xr.Dataset) -> tuple[np.ndarray, np.ndarray, float]:
    """Return lift coefficients of flight and model (sample,), and how a wrong angle moves the lift.

    The last one is the median change of the model's lift over its size, by the angle of attack.
    [rad-1]

    Samples on the wheels, at low airspeed and with little lift are left out.
    """
    count = states.sizes["time"]
    terms = [k for k, name in enumerate(model.terms) if name.startswith("CL/")]
    area = float(model.meta["database"]["S"])

    def channel(name: str) -> np.ndarray:
        return np.broadcast_to(states.variables[name].values.astype(float), count)

    columns = np.zeros((count, len(model.variables)))
    for k, name in enumerate(model.variables):
        if name in states:
            columns[:, k] = channel(name)
        elif name == "h_agl":
            columns[:, k] = FREE_AIR
    simulation = Simulation(model.model)

    def lift(columns: np.ndarray) -> np.ndarray:
        return simulation.evaluate(columns)[1][:, terms].sum(axis=1)

    expected = lift(columns)
    # specific force less thrust, along the lift
    engines = [str(name) for name in states.data_vars if str(name).endswith(".thrust")]
    mass, alpha = channel("mass"), channel("alpha")
    ax = channel("ax") - sum(channel(name) for name in engines) / mass
    force = mass * (ax * np.sin(alpha) - channel("az") * np.cos(alpha))
    measured = force / (channel("qbar") * area)
    is_flying = (channel("V") > SLOWEST) & (np.abs(expected) > LEAST_LIFT) & ~on_wheels(states)
    is_counted = is_flying & np.isfinite(measured) & np.isfinite(expected)
    share_per_radian = 0.0
    if "alpha" in model.variables and is_counted.any():
        # a median needs few of the samples
        step = max(1, int(is_counted.sum()) // _SLOPES)
        few, base = columns[is_counted][::step].copy(), expected[is_counted][::step]
        few[:, model.variables.index("alpha")] += _STEP
        share_per_radian = float(np.median(np.abs((lift(few) - base) / (_STEP * base))))
    return measured[is_counted], expected[is_counted], share_per_radian


def on_wheels(states: xr.Dataset) -> np.ndarray:
    """Return the samples of a flight with a wheel on the ground (time,).

    All are false for a record without switches of the wheels.
    """
    rolling = np.zeros(states.sizes["time"], bool)
    for name in map(str, states.data_vars):
        if name.startswith("wow"):
            rolling |= states.variables[name].values.astype(float) >= 0.5
    return rolling
