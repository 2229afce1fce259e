"""Fly the recordings of ``flight/``: the aeroplane of `aeroplane.py` with modelled instruments.

    python make_records.py [FOLDER]          # numpy and pandas; writes FOLDER/flight
    python make_records.py --ice [FOLDER]    # flights with ice on the tail, FOLDER/iced

Between the inputs a simple pilot holds heading, height and speed, or with a climb the speed alone;
during an input all other controls stay.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path

import aeroplane
import numpy as np
import pandas as pd

RATE, STEPS = 20, 2  # records per second, steps of the simulation per record
DEG, KT, FT, G0 = math.pi / 180.0, 1852 / 3600, 0.3048, 9.80665
IMU = np.array([0.30, 0.10, 0.20])  # from the reference point [m]
VANES = np.array([6.2, 0.0, 0.1])  # nose boom with the pitot-static tube
RUDDER_STOP = 22.0 * DEG
SETTLING = 90.0  # before the recorder starts [s]

# Constant errors of the instruments, noise of a sample, in the units of the columns
BIAS = {"p": 0.04, "q": -0.03, "r": 0.05, "phi": -0.07, "theta": 0.06, "psi": 0.15}
BIAS |= {"nx": 0.002, "ny": -0.003, "nz": 0.005, "alpha": 0.35, "beta": -0.30, "oat": 0.4}
BIAS |= {"elevator": 0.10, "aileron": -0.10, "rudder": 0.12}
FACTOR = {"alpha": 1.05, "beta": 1.03, "torque1": 1.006, "torque2": 0.995}
DELAY = {
    "cas": 0.10,
    "altitude": 0.10,
    "oat": 0.10,
    "vn": 0.15,
    "ve": 0.15,
    "vs": 0.15,
    "gps": 0.15,
}
NOISE = {"p": 0.03, "q": 0.03, "r": 0.03, "phi": 0.03, "theta": 0.03, "psi": 0.05}
NOISE |= {"nx": 0.002, "ny": 0.002, "nz": 0.004, "alpha": 0.08, "beta": 0.08, "cas": 0.15}
NOISE |= {"altitude": 1.5, "oat": 0.1, "elevator": 0.03, "aileron": 0.03, "rudder": 0.03}
NOISE |= {"vn": 0.1, "ve": 0.1, "vs": 10.0, "gps": 2.0, "lever1": 0.1, "lever2": 0.1}
NOISE |= {"ng1": 0.1, "ng2": 0.1, "torque1": 12.0, "torque2": 12.0, "rpm1": 2.0, "rpm2": 2.0}

COLUMNS = {  # heading of the file: (quantity, decimals)
    "Time (s)": ("time", 2),
    "CAS (kt)": ("cas", 1),
    "Press Alt (ft)": ("altitude", 0),
    "OAT (degC)": ("oat", 1),
    "AOA (deg)": ("alpha", 2),
    "AOS (deg)": ("beta", 2),
    "Pitch (deg)": ("theta", 2),
    "Roll (deg)": ("phi", 2),
    "Heading (deg)": ("psi", 2),
    "Roll Rate (deg/s)": ("p", 2),
    "Pitch Rate (deg/s)": ("q", 2),
    "Yaw Rate (deg/s)": ("r", 2),
    "Nx (g)": ("nx", 3),
    "Ny (g)": ("ny", 3),
    "Nz (g)": ("nz", 3),
    "Elevator (deg)": ("elevator", 2),
    "Aileron (deg)": ("aileron", 2),
    "Rudder (deg)": ("rudder", 2),
    "GS North (kt)": ("vn", 1),
    "GS East (kt)": ("ve", 1),
    "VS (ft/min)": ("vs", 0),
    "GPS Alt (ft)": ("gps", 0),
}
for side in (1, 2):
    COLUMNS |= {
        f"Power Lever {side} (%)": (f"lever{side}", 1),
        f"Fuel Cut {side}": (f"cut{side}", 0),
        f"Ng {side} (%)": (f"ng{side}", 1),
        f"Torque {side} (N m)": (f"torque{side}", 0),
        f"Np {side} (rpm)": (f"rpm{side}", 0),
    }


class Flight:
    """The aeroplane with a pilot, from settled flight on."""

    SLEW = {"elevator": 0.7, "aileron": 0.7, "rudder": 0.7, "lever1": 0.8, "lever2": 0.8}

    def __init__(
        self, cas: float, altitude: float, lever: float, failed: int, climbs: bool, ice: float
    ) -> None:
        self.x = [aeroplane.START.get(name, 0.0) for name in aeroplane.STATES]
        self.x[11], self.x[15], self.x[19] = altitude * FT, 0.5, 0.5
        self.x[13] = self.x[17] = 1.0
        density = aeroplane.air(altitude * FT)[2]
        self.speed = cas * KT * math.sqrt(1.225 / density)
        self.x[0] = self.speed
        self.want = {
            "elevator": 0.0,
            "aileron": 0.0,
            "rudder": 0.0,
            "lever1": lever,
            "lever2": lever,
        }
        self.want |= {"cut1": 0.0, "cut2": 0.0, "ice": ice}
        if failed:
            self.want[f"cut{failed}"] = 1.0
        self.failed, self.climbs = failed, climbs
        self.have = dict(self.want)
        self.height, self.heading, self.bank = altitude * FT, 0.0, 0.0
        self.sums = {"pitch": 0.0, "speed": 0.0, "yaw": 0.0, "turn": 0.0}
        self.base = dict(self.want)
        self.rows: list[dict[str, float]] = []

    def see(self) -> dict[str, float]:
        """Return states, controls and what there is to measure."""
        _, seen = aeroplane.derivatives(self.x, self.have)
        return dict(zip(aeroplane.STATES, self.x)) | seen | self.have

    def hold(self) -> None:
        """Move the controls towards the flight that is held."""
        s, want = self.see(), self.want
        turn = (self.heading - s["psi"] + math.pi) % (2.0 * math.pi) - math.pi
        phi = self.bank + min(max(0.9 * turn, -0.3), 0.3)
        want["aileron"] = self.base["aileron"] - 0.9 * (phi - s["phi"]) + 0.5 * s["p"]
        # the feet hold the sideslip at zero
        self.sums["yaw"] -= 0.25 * s["beta"] / RATE
        rudder = self.base["rudder"] + self.sums["yaw"] + 0.4 * s["r"] - 0.3 * s["beta"]
        want["rudder"] = min(max(rudder, -0.35), 0.35)
        if self.climbs:
            # the pitch attitude holds the speed
            fast = min(max(s["V"] - self.speed, -4.0), 4.0)
            self.sums["speed"] += 0.0015 * fast / RATE
            error = 0.05 + self.sums["speed"] + 0.012 * fast - s["theta"]
            error = min(max(error, -0.1), 0.1)
        else:
            climb = min(max(0.12 * (self.height - s["h"]), -2.0), 2.0)
            error = min(max((climb + s["vd"]) / s["V"], -0.1), 0.1)
        self.sums["pitch"] -= 0.25 * error / RATE
        want["elevator"] = self.base["elevator"] + self.sums["pitch"] - 0.9 * error + 0.6 * s["q"]
        if not self.climbs:
            slow = self.speed - s["V"]
            self.sums["speed"] += 0.008 * slow / RATE
            for k in (1, 2):
                lever = self.base[f"lever{k}"] + self.sums["speed"] + 0.04 * slow
                want[f"lever{k}"] = min(max(lever, 0.0), 1.0)

    def slow_down(self, rate: float, bank: float) -> None:
        """Lose speed [kt/s] at a bank [rad]; the rudder holds the heading up to its stop."""
        self.speed -= rate * KT / RATE
        self.hold()
        s, want = self.see(), self.want
        self.bank += min(max(bank - self.bank, -0.03 / RATE), 0.03 / RATE)
        want["aileron"] = self.base["aileron"] - 0.9 * (self.bank - s["phi"]) + 0.5 * s["p"]
        turn = (self.heading - s["psi"] + math.pi) % (2.0 * math.pi) - math.pi
        if abs(want["rudder"]) < RUDDER_STOP:
            self.sums["turn"] -= 0.4 * turn / RATE
        rudder = self.base["rudder"] + self.sums["turn"] - 1.2 * turn + 1.0 * s["r"]
        want["rudder"] = min(max(rudder, -RUDDER_STOP), RUDDER_STOP)

    def step(self) -> None:
        """Advance by one record."""
        for _ in range(STEPS):
            dt = 1.0 / (RATE * STEPS)
            for name, limit in self.SLEW.items():
                move = self.want[name] - self.have[name]
                self.have[name] += min(max(move, -limit * dt), limit * dt)
            for k in (1, 2):
                self.have[f"cut{k}"] = self.want[f"cut{k}"]
            self.x = aeroplane.advance(self.x, self.have, dt)
        self.rows.append(self.see())

    def during(self, seconds: float, action: Callable[[float], None] | None = None) -> None:
        """Fly for a time; an action gets the time since its begin."""
        for k in range(round(seconds * RATE)):
            if action:
                action(k / RATE)
            self.step()

    def settle(self) -> None:
        """Take the controls of the moment as those that the pilot lets go to."""
        self.base = dict(self.want)
        attitude = self.sums["speed"] if self.climbs else 0.0
        self.sums = {"pitch": 0.0, "speed": attitude, "yaw": 0.0, "turn": 0.0}


def fly(cas: float, altitude: float, cards: list[tuple], **more) -> pd.DataFrame:
    """Return the motion of one run, without errors."""
    setting = {"lever": 0.6, "failed": 0, "climbs": False, "ice": 0.0} | more
    f = Flight(cas, altitude, **setting)
    f.during(SETTLING, lambda t: f.hold())
    f.settle()
    f.rows.clear()
    f.height = f.x[11]
    for kind, *values in cards:
        start = dict(f.want)
        if kind == "free":
            f.during(values[0])
        elif kind == "hold":
            f.during(values[0], lambda t: f.hold())
            f.settle()
        elif kind == "steps":  # control, amplitude, unit of time, signs in units of time, after
            control, size, unit, signs, after = values
            for sign, units in signs:
                f.want[control] = start[control] + sign * size
                f.during(units * unit)
            f.want[control] = start[control]
            f.during(after)
        elif kind == "lever":  # both levers to a value, seconds
            f.want["lever1"] = f.want["lever2"] = values[0]
            f.during(values[1])
        elif kind == "fail":  # engine, seconds with the controls where they are
            f.want[f"cut{values[0]}"] = 1.0
            f.during(values[1])
        elif kind == "pull_push":
            size, seconds = values

            def pull(t: float, size=size, seconds=seconds, start=start) -> None:
                f.want["elevator"] = start["elevator"] - size * math.sin(
                    2.0 * math.pi * t / seconds
                )

            f.during(seconds, pull)
        elif kind == "sideslip":
            size, seconds = values

            def slip(t: float, size=size, seconds=seconds, start=start) -> None:
                f.hold()
                share = min(t / 2.5, 1.0, max(seconds - t, 0.0) / 1.5)
                f.want["rudder"] = start["rudder"] + size * share
                f.sums["yaw"] = 0.0

            f.during(seconds, slip)
        elif kind == "slow_down":  # rate [kt/s], bank [rad], seconds

            def slow(t: float, values=values) -> None:
                f.slow_down(*values[:2])

            f.during(values[2], slow)
        else:
            raise ValueError(kind)
    return pd.DataFrame(f.rows)


def measured(motion: pd.DataFrame, wind: np.ndarray, seed: int) -> pd.DataFrame:
    """Return what the recorder holds; a steady wind [kt] adds to the speed over the ground."""
    rng = np.random.default_rng([743, seed])
    m = {name: motion[name].to_numpy() for name in motion}
    time = np.arange(len(motion)) / RATE
    omega, omega_dot = (np.stack([m[n + tail] for n in "pqr"], 1) for tail in ("", "_dot"))
    force = np.stack([m["ax"], m["ay"], m["az"]], 1)
    force = force + np.cross(omega_dot, IMU) + np.cross(omega, np.cross(omega, IMU))
    flow = np.stack([m["u"], m["v"], m["w"]], 1) + np.cross(omega, VANES)
    speed = np.linalg.norm(flow, axis=1)
    impact = m["p_static"] * ((1 + 0.2 * (m["mach"] * speed / m["V"]) ** 2) ** 3.5 - 1)
    static = m["p_static"] + 0.008 * impact
    impact = impact * (1 - 0.008)
    x = {
        "cas": np.sqrt(7 * 287.05287 * 288.15 * ((impact / 101325 + 1) ** (2 / 7) - 1)) / KT,
        "altitude": 288.15 / 0.0065 * (1 - (static / 101325) ** (287.05287 * 0.0065 / G0)) / FT,
        "oat": m["temperature"] - 273.15,
        "alpha": np.arctan2(flow[:, 2], flow[:, 0]) / DEG,
        "beta": np.arctan2(flow[:, 1], flow[:, 0]) / DEG,
        "psi": np.unwrap(m["psi"]) / DEG + 40.0,
        "nx": force[:, 0] / G0,
        "ny": force[:, 1] / G0,
        "nz": -force[:, 2] / G0,
        "vs": -m["vd"] / FT * 60,
        "gps": aeroplane.geometric_height(m["h"]) / FT,
        "cut1": m["cut1"],
        "cut2": m["cut2"],
    }
    # the heading of the simulation is 40 deg less
    c, s = math.cos(40.0 * DEG), math.sin(40.0 * DEG)
    x |= {
        "vn": (m["vn"] * c - m["ve"] * s) / KT + wind[0],
        "ve": (m["vn"] * s + m["ve"] * c) / KT + wind[1],
    }
    x |= {
        name: m[name] / DEG
        for name in ("phi", "theta", "p", "q", "r", "elevator", "aileron", "rudder")
    }
    for k in (1, 2):
        x |= {f"lever{k}": 100 * m[f"lever{k}"], f"ng{k}": 100 * m[f"ng{k}"]}
        x |= {f"torque{k}": m[f"torque{k}"], f"rpm{k}": m[f"rpm{k}"] * 30 / np.pi}
    for name in x:
        late = np.interp(time - DELAY.get(name, 0.0), time, x[name])
        x[name] = late * FACTOR.get(name, 1.0) + BIAS.get(name, 0.0)
        x[name] += rng.normal(0.0, NOISE.get(name, 0.0), len(time))
    x["psi"] %= 360.0
    x["time"] = time
    columns = {heading: np.round(x[name], digits) for heading, (name, digits) in COLUMNS.items()}
    return pd.DataFrame(columns)


STEPS_3211 = [(1, 3), (-1, 2), (1, 1), (-1, 1)]
DOUBLET = [(1, 1), (-1, 1)]


def test_point(a: float) -> list[tuple]:
    """Return the card of one speed; `a` scales the inputs."""
    return [
        ("free", 5.0),
        ("steps", "elevator", 0.05 * a, 0.6, STEPS_3211, 4.0),
        ("hold", 10.0),
        ("steps", "aileron", 0.10 * a, 0.7, STEPS_3211, 3.0),
        ("hold", 10.0),
        ("steps", "rudder", 0.12 * a, 1.2, DOUBLET, 8.0),
        ("hold", 10.0),
        ("pull_push", 0.05 * a, 8.0),
        ("hold", 10.0),
        ("sideslip", 0.12, 9.0),
        ("hold", 10.0),
        ("lever", 0.2, 7.0),
        ("hold", 12.0),
        ("lever", 1.0, 7.0),
    ]


ONE_ENGINE = [
    ("free", 5.0),
    ("steps", "rudder", 0.08, 1.2, DOUBLET, 6.0),
    ("hold", 8.0),
    ("steps", "aileron", 0.08, 0.7, STEPS_3211, 3.0),
]
SLAM_AND_CHOP = [("free", 4.0), ("lever", 0.05, 10.0), ("lever", 1.0, 9.0), ("lever", 0.0, 9.0)]
# name: calibrated airspeed [kt], pressure altitude [ft], cards, what else
PROGRAMME = {
    "slow": (115.0, 6000.0, test_point(1.2), {}),
    "fast": (165.0, 6000.0, test_point(0.7), {}),
    "engine_out": (120.0, 6000.0, ONE_ENGINE, {"failed": 2}),
    "check_short_period": (
        140.0,
        7000.0,
        [("free", 4.0), ("steps", "elevator", 0.04, 0.8, DOUBLET, 6.0)],
        {},
    ),
    "check_phugoid": (
        140.0,
        7000.0,
        [("free", 4.0), ("steps", "elevator", 0.02, 2.5, [(-1, 1)], 75.0)],
        {},
    ),
    "check_roll": (
        140.0,
        7000.0,
        [("free", 4.0), ("steps", "aileron", 0.12, 2.0, [(1, 1)], 4.0)],
        {},
    ),
    "check_dutch_roll": (
        140.0,
        7000.0,
        [("free", 4.0), ("steps", "rudder", 0.10, 1.0, DOUBLET, 12.0)],
        {},
    ),
    "check_power": (140.0, 7000.0, [("free", 6.0), ("lever", 0.2, 17.5)], {}),
    "check_slam": (130.0, 7000.0, SLAM_AND_CHOP, {}),
    "check_engine_failure": (
        120.0,
        3000.0,
        [("free", 6.0), ("fail", 1, 6.0)],
        {"lever": 0.85, "climbs": True},
    ),
    "check_one_engine_trim": (125.0, 5000.0, [("hold", 12.0)], {"failed": 1}),
    "check_one_engine_climb": (
        115.0,
        3000.0,
        [("hold", 115.0)],
        {"failed": 1, "lever": 1.0, "climbs": True},
    ),
    "check_minimum_control": (
        105.0,
        4000.0,
        [("free", 2.0), ("slow_down", 0.7, 5.0 * DEG, 48.0)],
        {"failed": 1, "lever": 1.0, "climbs": True},
    ),
}


ICED = {
    "iced_slow": PROGRAMME["slow"],
    "iced_fast": PROGRAMME["fast"],
    "check_iced_short_period": PROGRAMME["check_short_period"],
    "check_iced_phugoid": PROGRAMME["check_phugoid"],
}


def main(folder: Path, programme: dict[str, tuple], ice: float = 0.0) -> None:
    """Write a CSV for each run; with ice it has the column ``Ice``."""
    folder.mkdir(parents=True, exist_ok=True)
    first = 100 if ice else 0
    winds = np.random.default_rng(743 + first).uniform(-12.0, 12.0, (len(programme), 2))
    for number, (name, (cas, altitude, cards, more)) in enumerate(programme.items()):
        motion = fly(cas, altitude, cards, **more, ice=ice)
        record = measured(motion, winds[number], first + number)
        if ice:
            record["Ice"] = ice
        record.to_csv(folder / f"{name}.csv", index=False, float_format="%.7g")
        print(f"{name:24s} {len(motion) / RATE:6.1f} s")


if __name__ == "__main__":
    arguments = [text for text in sys.argv[1:] if text != "--ice"]
    here = Path(arguments[0]) if arguments else Path(__file__).parent
    if "--ice" in sys.argv:
        main(here / "iced", ICED, 1.0)
    else:
        main(here / "flight", PROGRAMME)
