"""Stall model identified from flights of another generator, against unseen flights.

The generator is a strip theory in six degrees of freedom, of another form and with other numbers
than the product: eight strips per wing half with their own local flow, Leishman's two exponentials
for the steady separation, a lag that differs for separation and reattachment, a wing twisted by
washout, a tail in a downwash that falls with the lift, and sensors with noise and biases.  Sixteen
flights with a random asymmetry of the wing train the model, twenty others are predicted.

    python benchmarks/stall_strips.py [seed] [leading-edge | vortex]

prints R2 of CL, Cm and Cl on the unseen flights, and in how many of them the model, flown by the
kernel from the same start with the same controls, rolls off in the direction of the flight.

With `leading-edge` the wing is of another kind: its flow separates at once within half a degree and
reattaches 2.5 deg below, so that the steady lift has two values there, and the right half lags
behind the left one.  The product has no such state.

With `vortex` each strip has the dynamic stall of Leishman and Beddoes in short: the angle of attack
that drives the separation lags, the separation lags behind it, and lift that is lost while the flow
separates stays for a while as that of a vortex, which moves the nose down.  Three states a strip.
"""

from __future__ import annotations

import sys

import numpy as np
import xarray as xr

import flightmech
from flightmech import air
from flightmech.aircraft.engine import Engine
from flightmech.terms import make_term
from flighttest.reconstruction.dynamics.force_coefficients import coefficients
from flighttest.submodels.stall.identification import identify_stall

G = 9.80665
STEP = 0.01
EVERY = 2  # samples at 50 Hz
S, CBAR, SPAN, MASS = 17.0, 1.67, 10.3, 2400.0
IXX, IYY, IZZ = 10800.0, 8100.0, 15100.0
HEIGHT = 3000.0
KIND = next((kind for kind in ("leading-edge", "vortex") if kind in sys.argv[2:]), "trailing-edge")
STRIPS = 8
# strips at the middle of equal parts of the half span
Y = (np.arange(STRIPS) + 0.5) / STRIPS * 0.5 * SPAN
Y = np.concatenate([-Y[::-1], Y])
AREA = S / (2 * STRIPS)
WASHOUT = np.deg2rad(-1.5) * np.abs(Y) / (0.5 * SPAN)
SLOPE = 5.1
ZERO_LIFT = np.deg2rad(-2.2)
BREAK, SOFT, HARD = np.deg2rad(15.5), np.deg2rad(2.6), np.deg2rad(3.2)
ABRUPT, OVERLAP = np.deg2rad(0.4), np.deg2rad(2.5)  # of the wing with a leading-edge stall
LATER = 1.6  # lag of its right half over that of its left half
PRESSURE_LAG, SEPARATION_LAG, VORTEX_LAG = 0.05, 0.10, 0.20  # [s] at 60 m/s
VORTEX_SHARE = 0.7  # of the lift that separation takes
RHO = float(air.atmosphere(HEIGHT).rho)


def steady_separation(alpha: np.ndarray, alpha_break: np.ndarray) -> np.ndarray:
    """Return Leishman's separation point of a strip."""
    below = 1.0 - 0.3 * np.exp(np.minimum(alpha - alpha_break, 0.0) / SOFT)
    beyond = 0.04 + 0.66 * np.exp(np.minimum(alpha_break - alpha, 0.0) / HARD)
    return np.where(alpha <= alpha_break, below, beyond)


def separate(
    local: np.ndarray, q: float, f: np.ndarray, alpha_break: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the steady separation of the strips, and the lag at 60 m/s. [s]"""
    if KIND == "leading-edge":
        # a strip that is separated stays so down to a lower angle: two steady values between
        place = local - alpha_break + OVERLAP * (1.0 - f)
        steady = 0.03 + 0.95 / (1.0 + np.exp(np.clip(place / ABRUPT, -50.0, 50.0)))
        return steady, np.where(Y > 0.0, LATER, 1.0) * 0.12
    steady = steady_separation(local - 0.035 * q, alpha_break)
    return steady, np.where(steady < f, 0.09, 0.16)


def vortex_rates(
    local: np.ndarray, V: float, states: np.ndarray, alpha_break: np.ndarray
) -> np.ndarray:
    """Return the rates of separation, lagged angle of attack and lift of the vortex of strips."""
    f, late, vortex = states.reshape(3, -1)
    pace = V / 60.0
    late_rate = (local - late) / PRESSURE_LAG * pace
    f_rate = (steady_separation(late, alpha_break) - f) / SEPARATION_LAG * pace
    # lift of the attached flow less Kirchhoff's, whose slope over f is (1 + root) / (4 root)
    root = np.sqrt(np.maximum(f, 1e-3))
    lost = -SLOPE * (local - ZERO_LIFT) * 0.25 * (1.0 + root) / root * f_rate
    vortex_rate = VORTEX_SHARE * np.maximum(lost, 0.0) - vortex / VORTEX_LAG * pace
    return np.concatenate([f_rate, late_rate, vortex_rate])


def forces(x: np.ndarray, u: np.ndarray, alpha_break: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return coefficients (CL CD CY Cl Cm Cn) and the rates of the separation of the strips."""
    vx, vy, vz, p, q, r = x[:6]
    f, vortex = x[8 : 8 + 2 * STRIPS], np.zeros(2 * STRIPS)
    V = np.sqrt(vx * vx + vy * vy + vz * vz)
    alpha, beta = np.arctan2(vz, vx), np.arcsin(vy / V)
    uy, wy = vx - r * Y, vz + p * Y
    local = np.arctan2(wy, uy) + WASHOUT
    pressure = (uy * uy + wy * wy) / (V * V)
    if KIND == "vortex":
        change = vortex_rates(local, V, x[8:], alpha_break)
        vortex = x[8 + 4 * STRIPS :]
    else:
        steady, lag = separate(local, q, f, alpha_break)
        change = (steady - f) / (lag * 60.0 / V)
    factor = (0.5 * (1.0 + np.sqrt(f))) ** 2
    # ailerons on the outer three strips lose effect with the flow
    aileron = np.where(np.abs(Y) > Y[-4], 1.0, 0.0) * np.sign(Y)
    lift = SLOPE * factor * (local - ZERO_LIFT) + 2.1 * u[1] * aileron * (0.3 + 0.7 * f)
    lift = lift + vortex
    drag = 0.022 + 0.055 * lift**2 + 0.55 * (1.0 - f) * np.sin(np.abs(local)) ** 2
    share = AREA / S * pressure
    CL, CD = float(np.sum(share * lift)), float(np.sum(share * drag))
    normal = lift * np.cos(alpha) + drag * np.sin(alpha)
    axial = lift * np.sin(alpha) - drag * np.cos(alpha)
    roll = -float(np.sum(share * normal * Y)) / SPAN
    yaw = -float(np.sum(share * axial * Y)) / SPAN
    downwash = 0.07 * CL / 0.9
    tail = (
        3.4
        * (alpha - downwash + q * 4.6 / V + 0.62 * u[0] - 0.045)
        * (1.0 - 0.12 * (1.0 - float(f.mean())))
    )
    CL += 0.2 * tail
    pitch = 0.04 + 0.03 * CL - 0.2 * tail * 4.6 / CBAR * 0.75 - 0.05 * (1.0 - float(f.mean()))
    pitch -= 3.5 * q * CBAR / (2.0 * V) + 0.12 * float(np.sum(share * vortex))
    fin = 1.0 - 0.3 * (1.0 - float(f.mean()))
    side = -0.55 * beta + 0.16 * u[2]
    roll += -0.075 * beta + 0.012 * u[2] - 0.03 * p * SPAN / (2 * V)
    yaw += fin * (0.09 * beta - 0.13 * r * SPAN / (2 * V) - 0.065 * u[2]) + 0.004 * u[1]
    return np.array([CL, CD, side, roll, pitch, yaw]), change


def rates(x: np.ndarray, u: np.ndarray, alpha_break: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rates of the state, and the specific force of the c.g."""
    vx, vy, vz, p, q, r, phi, theta = x[:8]
    c, separation = forces(x, u, alpha_break)
    V2 = vx * vx + vy * vy + vz * vz
    qS = 0.5 * RHO * V2 * S
    alpha = np.arctan2(vz, vx)
    sa, ca = np.sin(alpha), np.cos(alpha)
    thrust = u[3]
    a = np.array(
        [
            (qS * (c[0] * sa - c[1] * ca) + thrust) / MASS,
            qS * c[2] / MASS,
            -qS * (c[0] * ca + c[1] * sa) / MASS,
        ]
    )
    sp, cp, st, ct = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta)
    turn = (q * sp + r * cp) / ct
    dx = np.array(
        [
            a[0] - G * st - q * vz + r * vy,
            a[1] + G * ct * sp - r * vx + p * vz,
            a[2] + G * ct * cp - p * vy + q * vx,
            (qS * SPAN * c[3] + (IYY - IZZ) * q * r) / IXX,
            (qS * CBAR * c[4] + (IZZ - IXX) * p * r) / IYY,
            (qS * SPAN * c[5] + (IXX - IYY) * p * q) / IZZ,
            p + turn * st,
            q * cp - r * sp,
        ]
    )
    return np.concatenate([dx, separation]), a


def controls(t: float, x: np.ndarray, plan: dict[str, float], extra: np.ndarray) -> np.ndarray:
    """Return elevator, aileron, rudder and thrust of a pilot who follows an angle of attack."""
    alpha = np.arctan2(x[2], x[0])
    start, top = plan["start"], plan["top"]
    times = [0.0, 2.0, 2.0 + plan["up"], 2.0 + plan["up"] + plan["hold"], 99.0]
    times[4] = times[3] + plan["down"]
    wanted = np.interp(t, times, [start, start, top, top, start])
    elevator = plan["trim"] - 1.3 * (wanted - alpha) - 0.9 * (wanted - start) + 0.5 * x[4]
    level = t < 2.0 + 0.75 * plan["up"]
    aileron = np.clip(0.6 * x[6] + 0.25 * x[3], -0.2, 0.2) if level else 0.0
    if not level and t > times[3]:
        aileron = np.clip(0.5 * x[6] + 0.3 * x[3], -0.25, 0.25)
    u = np.array([elevator, aileron, 0.3 * x[5], plan["thrust"]])
    u[:3] += extra
    return np.clip(u, [-0.5, -0.35, -0.4, 0.0], [0.35, 0.35, 0.4, 1e5])


def fly(rng: np.random.Generator, kind: str, asymmetry: float) -> xr.Dataset:
    """Return the true motion of a stall with its controls, at 50 Hz."""
    alpha_break = BREAK + 0.5 * asymmetry * np.sign(Y)
    start = np.deg2rad(8.0)
    quasi = kind == "quasi-steady"
    plan = {
        "start": start,
        "top": np.deg2rad(rng.uniform(17.0, 20.0)),
        "up": rng.uniform(9.0, 14.0) if quasi else rng.uniform(1.5, 3.0),
        "hold": rng.uniform(1.0, 2.0),
        "down": rng.uniform(2.0, 3.0),
        "trim": -0.09,
        "thrust": rng.uniform(1500.0, 3000.0),
    }
    V = 66.0 if quasi else 74.0
    x = np.zeros(8 + (6 if KIND == "vortex" else 2) * STRIPS)
    x[0], x[2], x[7] = V * np.cos(start), V * np.sin(start), start
    strips = slice(8, 8 + 2 * STRIPS)
    x[strips] = steady_separation(start + WASHOUT, alpha_break)
    if KIND == "vortex":
        x[8 + 2 * STRIPS : 8 + 4 * STRIPS] = start + WASHOUT
    duration = 2.0 + plan["up"] + plan["hold"] + plan["down"] + 2.0
    phase, frequency = rng.uniform(0.0, 6.28, (3, 3)), rng.uniform(0.2, 1.1, (3, 3))
    size = np.array([0.008, 0.02, 0.02])
    rows = []
    for k in range(int(duration / STEP)):
        t = k * STEP
        extra = size * np.sin(2.0 * np.pi * frequency * t + phase).sum(axis=1)
        u = controls(t, x, plan, extra)
        k1, a = rates(x, u, alpha_break)
        if k % EVERY == 0:
            rows.append(np.concatenate([[t], x[:8], u, a, x[strips].reshape(2, -1).mean(axis=1)]))
        k2, _ = rates(x + 0.5 * STEP * k1, u, alpha_break)
        k3, _ = rates(x + 0.5 * STEP * k2, u, alpha_break)
        k4, _ = rates(x + STEP * k3, u, alpha_break)
        x = x + STEP / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        x[strips] = np.clip(x[strips], 0.0, 1.0)
    names = ("u", "v", "w", "p", "q", "r", "phi", "theta", "delta_e", "delta_a", "delta_r")
    names += ("thrust", "ax", "ay", "az", "f_left", "f_right")
    table = np.array(rows)
    columns = {name: ("time", table[:, i]) for i, name in enumerate(names, 1)}
    return xr.Dataset(columns, {"time": table[:, 0]})


def measured(rng: np.random.Generator, truth: xr.Dataset) -> xr.Dataset:
    """Return what the sensors show: noise and a bias of each."""
    n = truth.sizes["time"]

    def show(values: np.ndarray, noise: float, bias: float) -> np.ndarray:
        return values + noise * rng.normal(size=n) + bias * rng.normal()

    V = np.sqrt(truth["u"] ** 2 + truth["v"] ** 2 + truth["w"] ** 2).values
    signals = {
        "V": show(V, 0.2, 0.3),
        "alpha": show(np.arctan2(truth["w"].values, truth["u"].values), 1e-3, 2e-3),
        "beta": show(np.arcsin(truth["v"].values / V), 1e-3, 2e-3),
    }
    for name in "pqr":
        signals[name] = show(truth[name].values, 1e-3, 5e-4)
    for name in ("ax", "ay", "az"):
        signals[name] = show(truth[name].values, 0.05, 0.02)
    for name in ("delta_e", "delta_a", "delta_r"):
        signals[name] = show(truth[name].values, 5e-4, 1e-3)
    for name in ("phi", "theta"):
        signals[name] = show(truth[name].values, 5e-4, 1e-3)
    signals["engine1.thrust"] = truth["thrust"].values
    signals["qbar"] = 0.5 * RHO * signals["V"] ** 2
    signals["h"] = np.full(n, HEIGHT)
    return xr.Dataset({k: ("time", v) for k, v in signals.items()}, {"time": truth["time"].values})


def jet() -> flightmech.Aircraft:
    """Return the aircraft of the generator."""
    inertia = {"Ixx": IXX, "Iyy": IYY, "Izz": IZZ}
    engines = (Engine((0.0, 0.0, 0.0)),)
    return flightmech.Aircraft("strips", S, CBAR, SPAN, MASS, engines=engines, **inertia)


def compiled(found, aircraft: flightmech.Aircraft) -> flightmech.SimModel:
    """Return the identified model as a simulation: attached and separated terms of the fit."""
    leaves = dict(found.leaves())
    for model in found.fit.models:
        for term, shapes in model.shapes.items():
            if shapes:
                continue
            regressors = (
                [] if term == "1" else ["alpha", "alpha"] if "^2" in term else term.split("*")
            )
            value = found.term_value(model.target, term)[0]
            leaves[f"{model.target}/attached_{'_'.join(regressors) or 'basic'}"] = make_term(
                value, regressors=regressors
            )
    leaves["CY/beta"] = make_term(-0.55, regressors=["beta"])
    leaves["CY/rudder"] = make_term(0.16, regressors=["delta_r"])
    tree = xr.DataTree.from_dict({f"/{name}": leaf for name, leaf in leaves.items()})
    craft = flightmech.Aircraft(**{**vars(aircraft), "stall": found.separation()})
    return flightmech.compile(craft, tree)


def roll_off(phi: np.ndarray, f: np.ndarray) -> float:
    """Return the change of bank within the second and a half after both halves fall below 0.7."""
    stalled = np.flatnonzero(f < 0.7)
    if not len(stalled):
        return 0.0
    k = stalled[0]
    return float(phi[min(k + 75, len(phi) - 1)] - phi[k])


def flown(model: flightmech.SimModel, record: xr.Dataset) -> xr.Dataset:
    """Return the flight of the identified model from the start of a record with its controls."""
    first = record.isel(time=0)
    start = {
        f"init.{n}": float(first[n]) for n in ("V", "alpha", "beta", "p", "q", "r", "phi", "theta")
    }
    start |= {"init.h": HEIGHT, "mode.earth": 0.0, "mode.engine": 2.0, "mode.trim": 0.0}
    inputs = record[["delta_e", "delta_a", "delta_r"]].assign(
        {"engine1.thrust_drive": record["engine1.thrust"]}
    )
    return flightmech.simulate(model, inputs, start)


def main(seed: int = 1) -> None:
    """Identify, predict and print."""
    rng = np.random.default_rng(seed)
    aircraft = jet()
    asymmetry = np.deg2rad(rng.uniform(0.6, 1.2)) * rng.choice([-1.0, 1.0])
    kinds = ["quasi-steady", "accelerated"]

    def records(count: int) -> list[tuple[xr.Dataset, xr.Dataset]]:
        made = []
        for i in range(count):
            truth = fly(rng, kinds[i % 2], asymmetry)
            made.append((truth, coefficients(measured(rng, truth), aircraft, cutoff=4.0)))
        return made

    training, unseen = records(16), records(20)
    found = identify_stall([data for _, data in training], 0.25 * SPAN, CBAR)
    print(found.report())
    model = compiled(found, aircraft)
    sums = {name: [] for name in ("CL", "Cm", "Cl")}
    directions = []
    for truth, data in unseen:
        fitted = found.predict(data)
        for name in sums:
            z = data[name].values
            good = np.isfinite(z)
            sums[name].append((z[good], fitted[name].values[good]))
        f = 0.5 * (truth["f_left"] + truth["f_right"]).values
        own = flown(model, data)
        X = 0.5 * (own["stall.X_left"] + own["stall.X_right"]).values
        directions.append((roll_off(truth["phi"].values, f), roll_off(own["phi"].values, X)))
    for name, pairs in sums.items():
        z, y = np.concatenate([a for a, _ in pairs]), np.concatenate([b for _, b in pairs])
        print(f"{name}: R2 {1.0 - np.sum((z - y) ** 2) / np.sum((z - z.mean()) ** 2):.4f}")
    same = sum(np.sign(a) == np.sign(b) for a, b in directions)
    print(
        f"direction of the roll-off: {same} of {len(directions)}, asymmetry "
        f"{np.rad2deg(asymmetry):.2f} deg"
    )
    print("bank of flight and model [deg]:", np.rad2deg(np.array(directions)).round(0).tolist())


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
