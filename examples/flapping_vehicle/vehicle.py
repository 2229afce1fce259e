"""A flapping vehicle of seven bodies in free flight, simulated: markers, commands and truth for the
study of `flighttest.multibody`.

Equations of motion by summing over bodies with their Jacobians (Grauer and others, AIAA 2010-7632,
eq. (7)), the four-bar by the intersection of two circles, wings and tail by eq. (11), (12), (14),
(15), actuators by eq. (8); a Runge-Kutta method of fourth order with fixed step.  Numbers are our
own, near those of the paper.  Nothing here uses the library that identifies it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

G, RHO = 9.80665, 1.2
FLAPPING, NOISE, MISSING = (
    5.0,
    3e-4,
    0.02,
)  # [Hz], of a coordinate of a marker [m], share of markers not seen
HALF, X = 0.28, np.array([1.0, 0.0, 0.0])
PIN_ROCKER, PIN_COUPLER = np.array([0.0, 0.025, 0.0]), np.array([0.0, 0.0250, -0.0584])
# name: parent, origin in axes of the parent, axis, mass, c.g., principal moments of inertia
BODIES = {
    "fuselage": (
        None,
        (0, 0, 0),
        (1, 0, 0),
        0.337,
        (0.01, -0.00045, 0.005),
        (4e-4, 3.5e-3, 3.5e-3),
    ),
    "crank": (
        "fuselage",
        (0.06, 0.03, 0.03),
        (1, 0, 0),
        0.003,
        (0.0, 0.0, -0.004),
        (3e-7, 2e-7, 2e-7),
    ),
    "coupler": (
        "crank",
        (0.0, 0.0, -0.011),
        (1, 0, 0),
        0.002,
        tuple(PIN_COUPLER / 2.0),
        (9e-7, 6e-7, 4e-7),
    ),
    "wing_right": (
        "fuselage",
        (0.06, 0.03, -0.03),
        (1, 0, 0),
        0.0428,
        (-0.05, 0.22, 0.0),
        (1.08e-3, 1.4e-4, 1.22e-3),
    ),
    "wing_left": (
        "fuselage",
        (0.06, -0.03, -0.03),
        (1, 0, 0),
        0.0428,
        (-0.05, -0.22, 0.0),
        (1.08e-3, 1.4e-4, 1.22e-3),
    ),
    "tail_mount": (
        "fuselage",
        (-0.30, 0.0, 0.0),
        (0, 1, 0),
        0.004,
        (-0.01, 0.0, 0.0),
        (2e-7, 4e-7, 4e-7),
    ),
    "tail": (
        "tail_mount",
        (-0.02, 0.0, 0.0),
        (1, 0, 0),
        0.0185,
        (-0.05, 0.0, 0.0),
        (6e-5, 4e-5, 9e-5),
    ),
}
NAMES = list(BODIES)
MARKERS = {
    "fuselage": {"nose": (0.20, 0.0, 0.01), "left": (0.02, -0.05, -0.06),
        "right": (0.0, 0.05, -0.06), "back": (-0.20, 0.01, -0.03),
                 "belly": (-0.03, 0.0, 0.06)},
    "wing_right": {"wr1": (-0.01, 0.15, 0.0), "wr2": (-0.01, 0.45, 0.0), "wr3": (-0.15, 0.25, 0.0)},
    "wing_left": {"wl1": (-0.01, -0.15, 0.0), "wl2": (-0.01, -0.45, 0.0),
        "wl3": (-0.15, -0.25, 0.0)},
    "tail": {"t1": (-0.02, 0.08, 0.0), "t2": (-0.02, -0.08, 0.0), "t3": (-0.12, 0.0, 0.0)},
}  # fmt: skip
S, WING_POINT = 0.27, np.array([-0.0615, HALF, 0.0])
S_TAIL, TAIL_POINT = 0.032, np.array([-0.05, 0.0, 0.0])
CL = {"1": -1.72, "u": 0.55, "w": 0.12, "q": 0.28, "rate": 0.032}
CD = {"1": 0.037, "rate": -0.0070, "angle**2": 0.44, "rate**2": -0.0015}
CL_TAIL = {
    "1": 0.0623,
    "alpha": 1.1436,
    "alpha*beta": -0.2075,
    "alpha**3": -0.4560,
    "alpha**2*beta**2": 0.2454,
}
CD_TAIL = {"1": 0.0872, "alpha**2": 0.3325}
# Ma [kg m2], Ca [N m s], Ka, B [N m] of crank, tail pitch, tail roll
ACTUATORS = {
    "crank": (4e-3, 6e-2, 0.0, 2.5, "throttle"),
    "tail_mount": (2.5e-5, 5e-3, 0.18, 0.18, "tail_pitch"),
    "tail": (2.5e-5, 5e-3, 0.18, 0.18, "tail_roll"),
}
MA, CA, KA, GAIN = np.array([row[:4] for row in ACTUATORS.values()]).T
SPRING = 0.05  # of the right wing [N m/rad]
STEP = 1e-3  # of the integration [s]
# u, w, pitch, q, rate of the crank, throttle, tail command: a turn of the crank ends as it began
START = (5.012, 0.678, 0.0475, -0.477, 31.4, 0.682, -0.149)

_PARENT = [NAMES.index(row[0]) if row[0] else -1 for row in BODIES.values()]
_AT = np.array([row[1] for row in BODIES.values()], float)
_AXIS = np.array([row[2] for row in BODIES.values()], float)
_MASS = np.array([row[3] for row in BODIES.values()])
_CG = np.array([row[4] for row in BODIES.values()])
_I = np.array([np.diag(row[5]) for row in BODIES.values()])
_CROSS = np.array([[[0, -n[2], n[1]], [n[2], 0, -n[0]], [-n[1], n[0], 0]] for n in _AXIS])


def skew(v: np.ndarray) -> np.ndarray:
    """Return the matrix of the cross product."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def linkage(crank: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the angles of coupler (on the crank) and right wing, and their first and second
    derivatives by the angle of the crank.

    The pin lies where the circle about the pin of the crank meets that about the hinge of the wing,
    in the plane y, z.
    """
    c, s = np.cos(crank), np.sin(crank)
    turn = np.array([[c, -s], [s, c]])
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    bar = turn @ _AT[2, 1:]
    first, hinge = _AT[1, 1:] + bar, _AT[3, 1:]
    b, r = np.linalg.norm(PIN_COUPLER), np.linalg.norm(PIN_ROCKER)
    d = hinge - first
    size = np.hypot(*d)
    along = (b**2 - r**2 + size**2) / (2.0 * size)
    pin = first + along * d / size + np.sqrt(b**2 - along**2) * (quarter @ d) / size
    rod, arm = pin - first, pin - hinge
    # velocities: w x bar + wc x rod = ww x arm; accelerations by one more derivative
    A = np.column_stack([quarter @ rod, -quarter @ arm])
    rates = np.linalg.solve(A, -quarter @ bar)
    bends = np.linalg.solve(A, bar + rates[0] ** 2 * rod - rates[1] ** 2 * arm)
    angle = [
        np.arctan2(*v[::-1]) - np.arctan2(*u[::-1])
        for u, v in ((turn @ PIN_COUPLER[1:], rod), (PIN_ROCKER[1:], arm))
    ]
    wrapped = [(x + np.pi) % (2.0 * np.pi) - np.pi for x in angle]
    return np.array(wrapped), rates - [1.0, 0.0], bends


def joints(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return angles, slopes (joint, coordinate) and bends of the six joints after the base."""
    (coupler, wing), (coupler_1, wing_1), (coupler_2, wing_2) = linkage(theta[0])
    angles = np.array([theta[0], coupler, wing, -wing, theta[1], theta[2]])
    slopes = np.zeros((6, 3))
    slopes[:4, 0] = 1.0, coupler_1, wing_1, -wing_1
    slopes[4, 1] = slopes[5, 2] = 1.0
    return angles, slopes, np.array([0.0, coupler_2, wing_2, -wing_2, 0.0, 0.0])


def to_ned(q: np.ndarray) -> np.ndarray:
    """Return the matrix from body axes to north, east, down of a unit quaternion, scalar first."""
    v = skew(q[1:])
    return np.eye(3) + 2.0 * q[0] * v + 2.0 * v @ v


class Tree:
    """Bodies of one instant along axes of the fuselage: turns, origins, Jacobians (3, 9) and
    accelerations of no v_dot.
    """

    def __init__(self, theta: np.ndarray, v: np.ndarray):
        self.angles, slopes, bends = joints(theta)
        rates, quick = slopes @ v[6:], bends * v[6] ** 2
        self.rates, self.slopes = rates, slopes
        n = len(NAMES)
        self.turn, self.origin = [np.eye(3)], [np.zeros(3)]
        J_v, J_w = np.zeros((n, 3, 9)), np.zeros((n, 3, 9))  # of the origin, and of the rate
        J_v[0, :, :3] = J_w[0, :, 3:6] = np.eye(3)
        a, e = np.zeros((n, 3)), np.zeros((n, 3))  # acceleration of the origin and of the rate
        w = np.zeros((n, 3))
        w[0] = v[3:6]
        a[0] = _cross(v[3:6], v[:3])
        for k in range(1, n):
            up = _PARENT[k]
            phi = self.angles[k - 1]
            self.turn.append(
                self.turn[up]
                @ (
                    np.eye(3)
                    + np.sin(phi) * _CROSS[k]
                    + (1.0 - np.cos(phi)) * _CROSS[k] @ _CROSS[k]
                )
            )
            arm, axis = self.turn[up] @ _AT[k], self.turn[up] @ _AXIS[k]
            self.origin.append(self.origin[up] + arm)
            J_v[k] = J_v[up] - skew(arm) @ J_w[up]
            J_w[k] = J_w[up]
            J_w[k, :, 6:] = J_w[up, :, 6:] + np.outer(axis, slopes[k - 1])
            a[k] = a[up] + _cross(e[up], arm) + _cross(w[up], _cross(w[up], arm))
            w[k] = w[up] + rates[k - 1] * axis
            e[k] = e[up] + quick[k - 1] * axis + rates[k - 1] * _cross(w[up], axis)
        self.J_v, self.J_w, self.a, self.e, self.w = J_v, J_w, a, e, w

    def point(self, k: int, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return a point of body k and its Jacobian."""
        arm = self.turn[k] @ place
        return self.origin[k] + arm, self.J_v[k] - skew(arm) @ self.J_w[k]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def motion_loads(tree: Tree, down: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return M and the loads C v + g, with `down` the unit vector of gravity along axes of the
    fuselage.
    """
    M, h = np.zeros((9, 9)), np.zeros(9)
    for k, mass in enumerate(_MASS):
        arm = tree.turn[k] @ _CG[k]
        J = tree.J_v[k] - skew(arm) @ tree.J_w[k]
        w, e = tree.w[k], tree.e[k]
        a = tree.a[k] + _cross(e, arm) + _cross(w, _cross(w, arm)) - G * down
        I = tree.turn[k] @ _I[k] @ tree.turn[k].T
        M += mass * J.T @ J + tree.J_w[k].T @ I @ tree.J_w[k]
        h += mass * J.T @ a + tree.J_w[k].T @ (I @ e + _cross(w, I @ w))
    return M, h


def wing_coefficients(
    u: float, w: float, q: float, angle: float, rate: float
) -> tuple[float, float]:
    """Return CL and CD of the wings, eq. (14), (15)."""
    return (
        CL["1"] + CL["u"] * u + CL["w"] * w + CL["q"] * q + CL["rate"] * rate,
        CD["1"] + CD["rate"] * rate + CD["angle**2"] * angle**2 + CD["rate**2"] * rate**2,
    )


def along_stability_axes(lift: float, drag: float, alpha: float) -> np.ndarray:
    """Return a force along body axes."""
    c, s = np.cos(alpha), np.sin(alpha)
    return np.array([lift * s - drag * c, 0.0, -lift * c - drag * s])


def air_loads(tree: Tree, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the generalised air loads of wings and tail."""
    V = np.linalg.norm(v[:3])
    CL_w, CD_w = wing_coefficients(v[0], v[2], v[4], tree.angles[2], tree.rates[2])
    force = 0.5 * RHO * V**2 * S * along_stability_axes(CL_w, CD_w, np.arctan2(v[2], v[0]))
    wings = sum(
        tree.point(k, WING_POINT * [1.0, side, 1.0])[1].T @ (0.5 * force)
        for k, side in ((3, 1.0), (4, -1.0))
    )
    _, J = tree.point(6, TAIL_POINT)
    local = tree.turn[6].T @ (J @ v)
    speed = np.linalg.norm(local)
    alpha, beta = np.arctan2(local[2], local[0]), np.arcsin(local[1] / speed)
    lift, drag = (tail_coefficient(terms, alpha, beta) for terms in (CL_TAIL, CD_TAIL))
    return wings, J.T @ (
        tree.turn[6] @ (0.5 * RHO * speed**2 * S_TAIL * along_stability_axes(lift, drag, alpha))
    )


def tail_coefficient(terms: dict[str, float], alpha: float, beta: float) -> float:
    """Return a coefficient of the tail, eq. (11), (12)."""
    return sum(
        value * eval(term, {"alpha": alpha, "beta": beta}) for term, value in _compiled(terms)
    )


def _compiled(terms: dict[str, float]) -> list:
    key = id(terms)
    if key not in _CODE:
        _CODE[key] = [(compile(term, "<term>", "eval"), value) for term, value in terms.items()]
    return _CODE[key]


_CODE: dict[int, list] = {}


def accelerations(
    p: np.ndarray, v: np.ndarray, u: np.ndarray, air: bool = True, drives: bool = True
) -> tuple[np.ndarray, Tree]:
    """Return v_dot at position p, velocity v and commands u."""
    tree = Tree(p[7:], v)
    M, h = motion_loads(tree, to_ned(p[3:7])[2])
    loads = -h
    loads[6:] -= SPRING * tree.angles[2] * tree.slopes[2]
    if air:
        loads += sum(air_loads(tree, v))
    M[6:, 6:] += np.diag(MA)
    if drives:
        loads[6:] += GAIN * u - CA * v[6:] - KA * p[7:]
    return np.linalg.solve(M, loads), tree


def energy(p: np.ndarray, v: np.ndarray) -> float:
    """Return kinetic energy with that of the rotors, that of height and that of the spring. [J]"""
    tree = Tree(p[7:], v)
    R = to_ned(p[3:7])
    M, _ = motion_loads(tree, R[2])
    down = sum(m * (p[2] + R[2] @ tree.point(k, _CG[k])[0]) for k, m in enumerate(_MASS))
    return 0.5 * v @ M @ v + 0.5 * MA @ v[6:] ** 2 - G * down + 0.5 * SPRING * tree.angles[2] ** 2


def integrate(
    start: np.ndarray, commands, duration: float, rate: float = 500.0, **switches
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, states (time, 19) and commands (time, 3); `commands(t, state)` is held over a
    step of integration.
    """

    def slope(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        p, v = x[:10], x[10:]
        q = p[3:7]
        rates = 0.5 * np.concatenate([[-q[1:] @ v[3:6]], q[0] * v[3:6] + _cross(q[1:], v[3:6])])
        return np.concatenate(
            [
                to_ned(q / np.linalg.norm(q)) @ v[:3],
                rates,
                v[6:],
                accelerations(p, v, u, **switches)[0],
            ]
        )

    each, h = round(1.0 / (rate * STEP)), STEP
    x, times, found, given = start.copy(), [], [], []
    for k in range(round(duration / h)):
        u = commands(k * h, x)
        if k % each == 0:
            times.append(k * h)
            found.append(x.copy())
            given.append(u)
        a = slope(x, u)
        b = slope(x + 0.5 * h * a, u)
        c = slope(x + 0.5 * h * b, u)
        d = slope(x + h * c, u)
        x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        x[3:7] /= np.linalg.norm(x[3:7])
    return np.array(times), np.array(found), np.array(given)


class Pilot:
    """Holds pitch, height and wings level by small gains, and adds doublets, steps and pulses of
    his own.
    """

    def __init__(self, trim: tuple[float, float, float], seed: int | None = None):
        self.throttle, self.tail, self.pitch = trim
        rng = np.random.default_rng(seed)
        quiet = 0.0 if seed is None else 1.0
        self.doublet = (
            quiet * rng.uniform(0.35, 0.60) * rng.choice([-1.0, 1.0]),
            rng.uniform(0.10, 0.25),
            rng.uniform(0.18, 0.26),
        )
        self.second = (
            quiet * rng.uniform(0.35, 0.60) * rng.choice([-1.0, 1.0]),
            rng.uniform(0.80, 0.95),
            rng.uniform(0.10, 0.16),
        )
        self.step = quiet * rng.uniform(0.20, 0.40) * rng.choice([-1.0, 1.0]), rng.uniform(0.1, 0.6)
        self.launch = quiet * rng.uniform(-0.6, 0.6)  # speed over that of START [m/s]
        self.pulse = (
            quiet * rng.uniform(0.05, 0.15) * rng.choice([-1.0, 1.0]),
            rng.uniform(0.2, 0.9),
            0.15,
        )

    def __call__(self, time: float, x: np.ndarray) -> np.ndarray:
        R = to_ned(x[3:7])
        pitch, bank = np.arcsin(-R[2, 0]), np.arctan2(R[2, 1], R[2, 2])
        climb = -R[2] @ x[10:13]
        throttle = self.throttle - 0.05 * climb
        throttle += self.throttle * self.step[0] * (time > self.step[1])
        tail = self.tail + 0.8 * (pitch - self.pitch) + 0.10 * x[14]
        for size, start, width in (self.doublet, self.second):
            tail += size * (
                (start < time < start + width) * 1.0 - (start + width < time < start + 2.0 * width)
            )
        size, start, width = self.pulse
        return np.array([throttle, tail, 0.3 * bank + size * (start < time < start + width)])


def start_state(u: float, w: float, pitch: float, q: float, rate: float, tail: float) -> np.ndarray:
    """Return a state with the crank at zero."""
    x = np.zeros(19)
    x[3], x[5], x[8] = np.cos(pitch / 2.0), np.sin(pitch / 2.0), tail
    x[10], x[12], x[14], x[16] = u, w, q, rate
    return x


def fly(seed: int | None, duration: float = 1.6, rate: float = 500.0) -> dict[str, np.ndarray]:
    """Return a flight that begins near START with the inputs of a pilot, and the truth of
    coefficients and loads.
    """
    u, w, pitch, q, crank, throttle, tail = START
    pilot = Pilot((throttle, tail, pitch), seed)
    times, X, given = integrate(
        start_state(u + pilot.launch, w, pitch, q, crank, tail), pilot, duration, rate
    )
    p, v = X[:, :10], X[:, 10:]
    trees = [Tree(a[7:], b) for a, b in zip(p, v)]
    angle, wing_rate = (
        np.array([getattr(tree, name)[2] for tree in trees]) for name in ("angles", "rates")
    )
    lift, drag = wing_coefficients(v[:, 0], v[:, 2], v[:, 4], angle, wing_rate)
    v_dot = np.array([accelerations(a, b, c)[0] for a, b, c in zip(p, v, given)])
    loads = np.array([air_loads(tree, b) for tree, b in zip(trees, v)])
    return {
        "time": times, "p": p, "v": v, "v_dot": v_dot, "commands": given, "CL": lift, "CD": drag,
        "angle": angle, "rate": wing_rate,
        "wings": loads[:, 0], "tail": loads[:, 1],
    }  # fmt: skip


def markers(
    flight: dict[str, np.ndarray], seed: int, noise: float = NOISE, missing: float = MISSING
) -> pd.DataFrame:
    """Return what the cameras record, x north, y west, z up, and the commands; a share of the
    markers is not seen.
    """
    rng, columns = np.random.default_rng(seed), {"time": flight["time"]}
    trees = [Tree(a[7:], b) for a, b in zip(flight["p"], flight["v"])]
    R = np.array([to_ned(a[3:7]) for a in flight["p"]])
    for body, places in MARKERS.items():
        k = NAMES.index(body)
        for name, place in places.items():
            inside = np.array([tree.origin[k] + tree.turn[k] @ np.array(place) for tree in trees])
            seen = (
                flight["p"][:, :3]
                + np.einsum("nij,nj->ni", R, inside)
                + noise * rng.standard_normal((len(R), 3))
            )
            seen[rng.random(len(R)) < missing] = np.nan
            columns |= dict(
                zip((f"{name}_x", f"{name}_y", f"{name}_z"), (seen * [1.0, -1.0, -1.0]).T)
            )
    return pd.DataFrame(
        columns | dict(zip((row[4] for row in ACTUATORS.values()), flight["commands"].T))
    )


def tree_file(fits: str | None = None) -> str:
    """Return the vehicle as the text of a TOML file, with the tail of the truth or of a folder of
    fits.
    """

    def metres(place) -> str:
        return "[" + ", ".join(f'"{x:.10g} m"' for x in place) + "]"

    lines = [
        f'rho = "{RHO} kg/m3"',
        "",
        "[reference]",
        f'S = "{S} m2"',
        "",
        "[cameras]",
        'axes = "north west up"',
    ]
    lines += [f'flapping_frequency = "{FLAPPING:g} Hz"', "multiples = 8"]
    for name, (parent, at, axis, mass, cg, inertia) in BODIES.items():
        lines += ["", f"[body.{name}]", f'mass = "{mass} kg"', f"cg = {metres(cg)}"]
        lines += ["inertia = [" + ", ".join(f'"{x} kg m2"' for x in inertia) + "]"]
        lines += (
            [f'parent = "{parent}"', f"at = {metres(at)}", f"axis = {list(axis)}"] if parent else []
        )
        if name in MARKERS:
            lines += [
                f"[body.{name}.markers]",
                *(f"{marker} = {metres(place)}" for marker, place in MARKERS[name].items()),
            ]
    lines += [
        "",
        "[linkage.stroke]",
        'crank = "crank"',
        'coupler = "coupler"',
        'rocker = "wing_right"',
    ]
    lines += [f"pin_on_coupler = {metres(PIN_COUPLER)}", f"pin_on_rocker = {metres(PIN_ROCKER)}"]
    lines += [
        "",
        "[gear.wing_left]",
        'follows = "wing_right"',
        "ratio = -1",
        "",
        "[spring.wing_right]",
        f'stiffness = "{SPRING} N m/rad"',
    ]
    for name, (Ma, Ca, Ka, B, command) in ACTUATORS.items():
        lines += [
            "",
            f"[actuator.{name}]",
            f"Ma = {Ma}",
            f"Ca = {Ca}",
            f"Ka = {Ka}",
            f"B = {B}",
            f'command = "{command}"',
        ]
    lines += [
        "",
        "[aerodynamics.tail]",
        'body = "tail"',
        f"point = {metres(TAIL_POINT)}",
        f'S = "{S_TAIL} m2"',
    ]
    if fits:
        lines += [f'fits = "{fits}"']
    else:
        for name, terms in (("CL", CL_TAIL), ("CD", CD_TAIL)):
            lines += [
                f"{name} = {{ "
                + ", ".join(f'"{term}" = {value}' for term, value in terms.items())
                + " }"
            ]
    return "\n".join(lines) + "\n"


def main(folder: Path) -> None:
    """Write three flights and the vehicle, whose tail is that of the fits in the folder
    tail_fits.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for seed in (1, 2, 3):
        markers(fly(seed), seed).round(7).to_csv(folder / f"flight_{seed}.csv", index=False)
    (folder / "vehicle.toml").write_text(tree_file("tail_fits"), encoding="utf-8")
    print(f"written: 3 flights and the vehicle in {folder}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "flights"))
