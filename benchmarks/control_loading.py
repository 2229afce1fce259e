"""Control loading identified from simulated circuits: bias without noise, and coverage.

    python benchmarks/control_loading.py [--sets 12] [--seed 1] [--method regression]
        [--bristle 4e-5] [--control pedal]

Every set has other constants, drawn within 25 % of those of an engineer's guess, and other noise.
It has four slow sweeps, four records of two pulses and four of two releases, at three speeds and
four tab settings, 100 samples per second: F is prescribed, and column, surface and air are
recorded. The simulation shares no code with the identification; dry friction is R tanh(v / v0) with
v0 = 0.2 mm/s. With ``--bristle`` it builds up over this travel b [m]: R y with
dy/ds = (1 - y sgn(v)) / b.
With ``--quiet`` nothing is added to the records: what remains is the bias of the method.
``--perturb 1e-12`` changes all channels by that part.  ``--control pedal`` takes pedals of the
T-37's size in place of an elevator: no bob weight, no tab, and sideslip for the angle of attack.
"""

from __future__ import annotations

import argparse
import time as clock
import warnings
from typing import NamedTuple

import numpy as np
import xarray as xr

import flighttest


class Circuit(NamedTuple):
    """A circuit: names of its channels, geometry of its surface, and a guess of every constant."""

    item: str
    deflection: str
    angle: str
    hinge: str
    gearing: float
    S_hinge: float
    c_hinge: float
    guess: dict[str, float]
    push: float  # force of the hand over that of an elevator


# Unbalance, bob weight and breakout are at the hand.
COLUMN = Circuit(
    "column", "delta_e", "alpha", "Ch_e = 1 + alpha + delta_e + delta_t", 1.8, 2.2, 0.33,
    {
        "Ch_e: 1": -0.008,
        "Ch_e: alpha": -0.11,
        "Ch_e: delta_e": -0.29,
        "Ch_e: delta_t": -0.39,
        "mass": 5.1,
        "damping": 24.0,
        "friction": 7.0,
        "cable_stiffness": 31000.0,
        "cable_damping": 50.0,
        "inertia": 0.5,
        "hinge_damping": 1.2,
        "hinge_friction": 3.1,
        "bob_weight": 0.53,
        "offset": 8.0,
        "preload": 5.5,
    },
    1.0,
)  # fmt: skip
PEDAL = Circuit(
    "pedal", "delta_r", "beta", "Ch_r = 1 + beta + delta_r", 4.4, 0.56, 0.40,
    {
        "Ch_r: 1": 0.0024,
        "Ch_r: beta": 0.074,
        "Ch_r: delta_r": -0.22,
        "mass": 6.5,
        "damping": 62.0,
        "friction": 22.0,
        "cable_stiffness": 64000.0,
        "cable_damping": 120.0,
        "inertia": 0.37,
        "hinge_damping": 0.46,
        "hinge_friction": 1.3,
        "offset": 1.1,
        "preload": 7.3,
    },
    1.3,
)  # fmt: skip
CIRCUITS = {"column": COLUMN, "pedal": PEDAL}
# Constants at the hand that are unknowns.
CONSTANTS = ("offset", "bob_weight", "preload", "friction", "damping", "mass")
SPREAD = 0.25
# Speed at which dry friction is developed [m/s], and travel at which the breakout is. [m]
SMOOTH_RATE, SMOOTH_TRAVEL = 2e-4, 2e-4
STEP, RATE = 1e-4, 100.0
# Dynamic pressure [Pa], angle of attack and tab [rad] of the four conditions.
CONDITIONS = (
    (1800.0, 0.10, -0.02),
    (3600.0, 0.05, 0.0),
    (6200.0, 0.02, 0.015),
    (3600.0, 0.05, 0.05),
)
NOISE = {
    "F_column": 0.6,
    "F_pedal": 0.6,
    "column": 5e-5,
    "pedal": 5e-5,
    "delta_e": 1.8e-4,
    "delta_r": 1.8e-4,
    "beta": 5e-4,
    "qbar": 4.0,
    "alpha": 5e-4,
    "delta_t": 4e-4,
    "nz": 4e-3,
}
LONG = {"sweep": 40.0, "pulse": 12.0, "release": 12.0}
G0 = 9.80665


def draw_constants(circuit: Circuit, rng: np.random.Generator) -> dict[str, float]:
    """Return the constants of one set."""
    drawn = {}
    for name, value in circuit.guess.items():
        drawn[name] = value * rng.uniform(1 - SPREAD, 1 + SPREAD)
    return drawn


def hand_force(kind: str, time: np.ndarray) -> np.ndarray:
    """Return the force of the hand. [N]"""
    if kind == "sweep":
        return 130.0 * np.sin(2.0 * np.pi * time / 20.0)
    if kind == "pulse":
        up = np.interp(time, [0.95, 1.05, 1.25, 1.35], [0.0, 90.0, 90.0, 0.0])
        return up + np.interp(time, [4.95, 5.05, 5.25, 5.35], [0.0, -70.0, -70.0, 0.0])
    first = np.where(time < 4.0, np.interp(time, [0.5, 2.0], [0.0, 85.0]), 0.0)
    second = np.interp(time, [6.5, 7.5], [0.0, -75.0])
    return first + np.where(time < 9.0, second, 0.0)


def air(kind: str, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return change of the angle [rad] and load factor, which follow the slow sweeps."""
    surge = np.zeros_like(time)
    if kind == "sweep":
        surge = 0.035 * np.sin(2.0 * np.pi * (time - 1.1) / 20.0)
    return surge, 1.0 + 9.2 * surge


def simulate(
    circuit: Circuit, sets: list[dict[str, float]], bristle: float | None = None
) -> dict[str, list[list[dict[str, np.ndarray]]]]:
    """Return the error-free records by kind (set, condition); all are integrated together.

    `bristle` is the travel that builds friction up; None: friction by the rate. [m]
    """
    p = {name: np.repeat([one[name] for one in sets], len(CONDITIONS)) for name in circuit.guess}
    p.setdefault("bob_weight", 0.0)
    stem = circuit.hinge.partition(" ")[0]
    Ch_0, Ch_angle, Ch_delta, Ch_tab = (
        p.get(f"{stem}: {term}", 0.0)
        for term in ("1", circuit.angle, circuit.deflection, "delta_t")
    )
    gearing = circuit.gearing
    qbar, alpha0, tab = (np.tile(x, len(sets)) for x in np.array(CONDITIONS).T)
    load = qbar * circuit.S_hinge * circuit.c_hinge * gearing
    aft = p["inertia"] * gearing**2
    grip, grip_aft = p["friction"], p["hinge_friction"] * gearing
    damping_aft = p["hinge_damping"] * gearing**2
    # Inputs (step, kind, 1) of all kinds; the short ones are integrated as long as the sweeps.
    count, per = round(max(LONG.values()) * RATE), round(1.0 / RATE / STEP)
    time = STEP * np.arange(count * per + 1)
    pushes = np.array([circuit.push * hand_force(kind, time) for kind in LONG]).T[..., None]
    surges, factors = (x.T[..., None] for x in np.moveaxis([air(k, time) for k in LONG], 0, 1))
    bob = p["bob_weight"] * G0
    free_hinge = load * (Ch_0 + Ch_angle * alpha0 + Ch_tab * tab)
    by_surge, by_travel = load * Ch_angle, load * Ch_delta * gearing
    # Breakout holds the control near the force-free travel of the hinge moment.
    a = np.tile(free_hinge / by_travel, (len(LONG), 1))
    s = a.copy()
    v, w = np.zeros_like(s), np.zeros_like(s)
    deflection, deflection_aft = np.zeros_like(s), np.zeros_like(s)
    kept = []
    # Two seconds at rest come first, in which the control settles.
    for k in range(-round(2.0 / STEP), len(time)):
        now = max(k, 0)
        if k >= 0 and k % per == 0:
            kept.append((s, a))
        cable = p["cable_stiffness"] * (s - a) + p["cable_damping"] * (v - w)
        hand = pushes[now] - p["offset"] - bob * (factors[now] - 1.0) - cable
        hand = hand - p["preload"] * np.tanh(s / SMOOTH_TRAVEL) - p["damping"] * v
        pull = cable - free_hinge - by_surge * surges[now] + by_travel * a - damping_aft * w
        if bristle is None:
            # The tanh of the next rate: friction is stiff.
            v = implicit_rate(v + STEP * hand / p["mass"], STEP * grip / p["mass"])
            w = implicit_rate(w + STEP * pull / aft, STEP * grip_aft / aft)
        else:
            deflection = deflect(deflection, STEP * v / bristle)
            deflection_aft = deflect(deflection_aft, STEP * w / bristle)
            v = v + STEP * (hand - grip * deflection) / p["mass"]
            w = w + STEP * (pull - grip_aft * deflection_aft) / aft
        s, a = s + STEP * v, a + STEP * w
    travel, surface = (np.array(x) for x in zip(*kept))
    simulated = {}
    n = len(CONDITIONS)
    for number, (kind, seconds) in enumerate(LONG.items()):
        samples = round(seconds * RATE) + 1
        at = slice(0, samples * per, per)
        records = []
        for k in range(s.shape[1]):
            records.append(
                {
                    "time": time[at],
                    f"F_{circuit.item}": pushes[at, number, 0],
                    circuit.item: travel[:samples, number, k],
                    circuit.deflection: -gearing * surface[:samples, number, k],
                    "qbar": np.full(samples, qbar[k]),
                    circuit.angle: alpha0[k] + surges[at, number, 0],
                    "delta_t": np.full(samples, tab[k]),
                    "nz": factors[at, number, 0],
                }
            )
        simulated[kind] = [records[i * n : (i + 1) * n] for i in range(len(sets))]
    return simulated


def deflect(y: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Return the deflection of bristles after a part of their travel; never beyond 1."""
    return (y + part) / (1.0 + np.abs(part))


def implicit_rate(free: np.ndarray, grip: np.ndarray) -> np.ndarray:
    """Return v of v + grip tanh(v / SMOOTH_RATE) = free, by Newton steps from the outer side."""
    v = np.where(np.abs(free) > grip, free - np.sign(free) * grip, 0.0)
    for _ in range(4):
        t = np.tanh(v / SMOOTH_RATE)
        v = v - (v + grip * t - free) / (1.0 + grip * (1.0 - t * t) / SMOOTH_RATE)
    return v


def measure(record: dict[str, np.ndarray], rng: np.random.Generator | None, perturb: float):
    """Return the record of the instruments."""
    time = record["time"]
    channels = {}
    for name, x in record.items():
        if name == "time":
            continue
        noise = 0.0 if rng is None else rng.normal(0.0, NOISE[name], len(x))
        channels[name] = ("time", (x + noise) * (1.0 + perturb * np.cos(np.arange(len(x)))))
    return xr.Dataset(channels, {"time": time})


def main() -> None:
    """Print bias or coverage of every constant."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sets", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quiet", action="store_true")
    parser.add_argument("--method", default="output error")
    parser.add_argument("--perturb", type=float, default=0.0)
    parser.add_argument("--bristle", type=float)
    parser.add_argument("--control", choices=CIRCUITS, default="column")
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    circuit = CIRCUITS[given.control]
    truths = [draw_constants(circuit, rng) for _ in range(given.sets)]
    begin = clock.process_time()
    simulated = simulate(circuit, truths, given.bristle)
    print(f"simulated in {clock.process_time() - begin:.0f} s of processor time", flush=True)
    unknown = [name for name in circuit.guess if name in CONSTANTS]
    loading = flighttest.control_loading.ControlLoading(
        circuit.item, -circuit.gearing, circuit.S_hinge, circuit.c_hinge, circuit.hinge, unknown
    )
    names = [*circuit.guess, "friction, both ends", "damping, both ends", "mass, both ends"]
    errors, spans = np.full((2, given.sets, len(names)), np.nan)
    for k, truth in enumerate(truths):
        noise = None if given.quiet else np.random.default_rng([given.seed, k])
        records = {}
        for kind, of_kind in simulated.items():
            records[kind] = [measure(one, noise, given.perturb) for one in of_kind[k]]
        begin = clock.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = flighttest.identify_control_loading(
                loading,
                records["sweep"],
                [*records["pulse"], *records["release"]],
                method=given.method,
            )
        values = {name: found.value(name) for name in circuit.guess}
        true = dict(truth)
        for name, (aft, power) in {
            "friction": ("hinge_friction", 1),
            "damping": ("hinge_damping", 2),
            "mass": ("inertia", 2),
        }.items():
            values[f"{name}, both ends"] = found.total(name)
            true[f"{name}, both ends"] = truth[name] + circuit.gearing**power * truth[aft]
        for j, name in enumerate(names):
            errors[k, j] = (values[name][0] - true[name]) / true[name]
            spans[k, j] = values[name][1] / abs(true[name])
        z = np.abs(errors[k] / spans[k])
        if found.response is not None:
            end = found.response.convergence
            widths = {n: f"{v:.2g} ({e:.1g})" for n, (v, e) in found.response.widths.items()}
            weights = {n: f"{w:.2g}" for n, w in found.response.friction_models.items()}
            kind = f"converged: {end.converged}"
            if np.isfinite(found.response.stationary_within):
                kind = f"stationary within {found.response.stationary_within:.2g} standard errors"
            print(
                f"  {kind}, {end.iterations} iterations; widths {widths}; friction models {weights}"
            )
        print(
            f"set {k}: {np.mean(z < 2.0):.0%} within two, worst {names[int(z.argmax())]} "
            f"{z.max():.1f}; {clock.process_time() - begin:.1f} s of processor time; "
            f"{'; '.join(remark.text for remark in found.remarks)}",
            flush=True,
        )
        if given.perturb or given.sets == 1:
            print(" ".join(f"{values[name][0]:.15g}" for name in names))
    print(f"{'':22}{'bias':>9}{'rms':>9}{'stderr':>9}{'within two':>12}{'rms z':>8}")
    for j, name in enumerate(names):
        z = errors[:, j] / spans[:, j]
        print(
            f"{name:22}{np.mean(errors[:, j]):9.2%}{np.sqrt(np.mean(errors[:, j] ** 2)):9.2%}"
            f"{np.mean(spans[:, j]):9.2%}{np.mean(np.abs(z) < 2.0):12.0%}"
            f"{np.sqrt(np.mean(z**2)):8.2f}"
        )
    single = len(circuit.guess)
    z = np.abs(errors / spans)
    print(f"all constants: {np.mean(z[:, :single] < 2.0):.1%} within two")
    # Those that the score of such sets looks at.
    scored = [j for j, name in enumerate(names) if name in SCORED or name.startswith("Ch_")]
    print(f"scored constants: {np.mean(z[:, scored] < 2.0):.1%} within two")


SCORED = (
    "preload",
    "offset",
    "mass",
    "inertia",
    "cable_stiffness",
    "friction, both ends",
)

if __name__ == "__main__":
    main()
