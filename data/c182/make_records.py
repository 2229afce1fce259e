"""Fly the recordings of ``flight/`` and ``stall/``: the aircraft ``c182`` of the pip package
``jsbsim``, its motion passed through modelled instruments.

    pip install jsbsim==1.3.3 numpy pandas
    python make_records.py [FOLDER]    # writes FOLDER/flight and FOLDER/stall

Nothing of the files of that package is kept; recordings are what this script flies.  The propeller
is corrected (`jsbsim_c182.py`).  Each run starts after the pilot has settled.  Between inputs a
simple pilot holds heading, height and speed; during an input all other controls stay where they
were.  Body axes x forward, y right, z down.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from jsbsim_c182 import load_aircraft

RATE, FRAMES = 25, 16  # records per second, frames of the simulation per record
FT, INCH, LBF, KT, LB, G0 = 0.3048, 0.0254, 4.4482216152605, 1852 / 3600, 0.45359237, 9.80665
INHG = 3386.389
DEG = np.pi / 180.0
# moment reference point of ../aircraft.toml [in], behind the firewall and above the base line
STATION, WATERLINE = 43.2, 39.5
IMU = np.array([0.40, 0.15, 0.25])  # [m] from that point, surveyed
VANES = np.array([1.10, -3.60, -0.55])  # boom on the left wing, carries the pitot tube as well

# Constant errors of the instruments, one set for the whole programme
BIAS = {
    "p": 0.05,
    "q": -0.04,
    "r": 0.06,
    "phi": -0.08,
    "theta": 0.07,
    "psi": 0.20,
    "nx": 0.003,
    "ny": -0.004,
    "nz": 0.006,
}
BIAS |= {
    "alpha": 0.45,
    "beta": -0.35,
    "elevator": 0.12,
    "aileron": -0.10,
    "rudder": 0.15,
    "oat": 0.5,
    "weight": 9.0,
}
FACTOR = {"alpha": 1.07, "beta": 1.04, "elevator": 1.008}
POSITION_ERROR = 0.012  # of the static pressure, over the impact pressure
# [s]
DELAY = {
    "cas": 0.12,
    "altitude": 0.12,
    "oat": 0.12,
    "vn": 0.15,
    "ve": 0.15,
    "vs": 0.15,
    "gps": 0.15,
}
VANE_LAG = 0.04  # [s]
PROP_LEVER = 0.9  # 0 for 900, 1 for 2400 rpm
TRIMMED = 100.0  # speed at which the simulation starts [kt]
SETTLING = 60.0  # before the recorder starts [s]
# White noise per sample, in the units of the columns
NOISE = {
    "p": 0.03,
    "q": 0.03,
    "r": 0.03,
    "phi": 0.03,
    "theta": 0.03,
    "psi": 0.05,
    "nx": 0.002,
    "ny": 0.002,
    "nz": 0.004,
}
NOISE |= {
    "alpha": 0.08,
    "beta": 0.08,
    "cas": 0.15,
    "altitude": 1.5,
    "oat": 0.1,
    "elevator": 0.03,
    "aileron": 0.03,
    "rudder": 0.03,
}
NOISE |= {
    "lever": 0.1,
    "prop_lever": 0.1,
    "rpm": 3.0,
    "map": 0.05,
    "vn": 0.10,
    "ve": 0.10,
    "vs": 10.0,
    "gps": 2.0,
}

COLUMNS = {  # heading of the file: (quantity, decimals)
    "Time (s)": ("time", 2),
    "CAS (kt)": ("cas", 2),
    "Press Alt (ft)": ("altitude", 1),
    "OAT (degC)": ("oat", 1),
    "AOA (deg)": ("alpha", 2),
    "AOS (deg)": ("beta", 2),
    "Pitch (deg)": ("theta", 2),
    "Roll (deg)": ("phi", 2),
    "Heading (deg)": ("psi", 2),
    "Roll Rate (deg/s)": ("p", 2),
    "Pitch Rate (deg/s)": ("q", 2),
    "Yaw Rate (deg/s)": ("r", 2),
    "Nx (g)": ("nx", 4),
    "Ny (g)": ("ny", 4),
    "Nz (g)": ("nz", 4),
    "Elevator (deg)": ("elevator", 2),
    "Aileron (deg)": ("aileron", 2),
    "Rudder (deg)": ("rudder", 2),
    "Power Lever (%)": ("lever", 1),
    "Prop Lever (%)": ("prop_lever", 1),
    "RPM": ("rpm", 0),
    "MAP (inHg)": ("map", 2),
    "GS North (kt)": ("vn", 2),
    "GS East (kt)": ("ve", 2),
    "VS (ft/min)": ("vs", 0),
    "GPS Alt (ft)": ("gps", 1),
    "Gross Wt (lb)": ("weight", 1),
    "CG Sta (in)": ("station", 2),
}

Action = Callable[[float], None]


class Aeroplane:
    """The aircraft, trimmed at the start, with controls that move at the speed of a hand."""

    COMMANDS = ("elevator", "aileron", "rudder", "throttle")
    SLEW = {"elevator": 2.5, "aileron": 2.5, "rudder": 2.5, "throttle": 0.7}  # of the command, 1/s

    def __init__(self, kcas: float, altitude: float) -> None:
        self.fdm = fdm = load_aircraft()
        fdm.set_dt(1.0 / (RATE * FRAMES))
        fdm["atmosphere/delta-T"] = 9.0  # [R], 5 K warmer than standard
        start = {
            "lat-geod-deg": 45.0,
            "terrain-elevation-ft": 0.0,
            "h-sl-ft": altitude,
            "psi-true-deg": 60.0,
            "vc-kts": kcas,
            "gamma-deg": 0.0,
        }
        for name, value in start.items():
            fdm["ic/" + name] = value
        fdm["fcs/advance-cmd-norm"] = PROP_LEVER
        fdm.run_ic()
        fdm["propulsion/set-running"] = -1
        fdm["simulation/do_simple_trim"] = 1
        self.trim = {name: fdm[f"fcs/{name}-cmd-norm"] for name in self.COMMANDS}
        self.want, self.have = dict(self.trim), dict(self.trim)
        self.rows: list[dict[str, float]] = [self.read()]

    def step(self) -> None:
        """Advance by one record."""
        for _ in range(FRAMES):
            for name in self.COMMANDS:
                limit = self.SLEW[name] / (RATE * FRAMES)
                self.have[name] += float(np.clip(self.want[name] - self.have[name], -limit, limit))
                self.fdm[f"fcs/{name}-cmd-norm"] = self.have[name]
            self.fdm.run()
        self.rows.append(self.read())

    def read(self) -> dict[str, float]:
        """Return what there is to measure, without errors, in SI."""
        f = self.fdm
        names = {
            "p": "velocities/p-rad_sec",
            "q": "velocities/q-rad_sec",
            "r": "velocities/r-rad_sec",
            "p_dot": "accelerations/pdot-rad_sec2",
        }
        names |= {
            "q_dot": "accelerations/qdot-rad_sec2",
            "r_dot": "accelerations/rdot-rad_sec2",
            "phi": "attitude/phi-rad",
        }
        names |= {
            "theta": "attitude/theta-rad",
            "psi": "attitude/psi-rad",
            "mach": "velocities/mach",
            "elevator": "fcs/elevator-pos-rad",
        }
        names |= {
            "aileron": "fcs/left-aileron-pos-rad",
            "rudder": "fcs/rudder-pos-rad",
            "lever": "fcs/throttle-pos-norm",
        }
        names |= {
            "rpm": "propulsion/engine/propeller-rpm",
            "map": "propulsion/engine/map-pa",
            "prop_lever": "fcs/advance-pos-norm",
        }
        d = {name: f[path] for name, path in names.items()}
        feet = {
            "u": "velocities/u-aero-fps",
            "v": "velocities/v-aero-fps",
            "w": "velocities/w-aero-fps",
            "vn": "velocities/v-north-fps",
        }
        feet |= {
            "ve": "velocities/v-east-fps",
            "vd": "velocities/v-down-fps",
            "h": "position/h-sl-ft",
        }
        d |= {name: f[path] * FT for name, path in feet.items()}
        d["p_static"], d["temperature"] = (
            f["atmosphere/P-psf"] * LBF / FT**2,
            f["atmosphere/T-R"] / 1.8,
        )
        d["mass"] = f["inertia/weight-lbs"] * LB
        d["x_cg"], d["z_cg"] = (
            (STATION - f["inertia/cg-x-in"]) * INCH,
            (WATERLINE - f["inertia/cg-z-in"]) * INCH,
        )
        for axis in "xyz":
            d["a" + axis] = (
                sum(f[f"forces/fb{axis}-{part}-lbs"] for part in ("aero", "prop")) * LBF / d["mass"]
            )
        return d

    @property
    def now(self) -> dict[str, float]:
        """The last record."""
        return self.rows[-1]


class Pilot:
    """Holds heading, height and speed; takes the trim along, so that he lets go without a jump."""

    def __init__(self, aeroplane: Aeroplane) -> None:
        self.a = aeroplane
        start = aeroplane.now
        self.h, self.psi, self.speed = start["h"], start["psi"], self.airspeed()
        self.pitch = start["theta"]
        self.sum = {"elevator": 0.0, "throttle": 0.0}

    def airspeed(self) -> float:
        now = self.a.now
        return float(np.sqrt(now["u"] ** 2 + now["v"] ** 2 + now["w"] ** 2))

    def laterally(self, bank: float | None = None) -> None:
        now, trim, want = self.a.now, self.a.trim, self.a.want
        turn = (self.psi - now["psi"] + np.pi) % (2 * np.pi) - np.pi
        phi = float(np.clip(1.2 * turn, -0.35, 0.35)) if bank is None else bank
        want["aileron"] = trim["aileron"] + float(
            np.clip(1.2 * (phi - now["phi"]) - 0.5 * now["p"], -0.5, 0.5)
        )
        want["rudder"] = trim["rudder"]

    def vertically(self) -> None:
        now, want = self.a.now, self.a.want
        climb = float(np.clip(0.15 * (self.h - now["h"]), -2.0, 2.0))
        # of the flight-path angle
        error = float(np.clip((climb + now["vd"]) / self.airspeed(), -0.15, 0.15))
        self.sum["elevator"] = float(np.clip(self.sum["elevator"] - 0.6 * error / RATE, -0.5, 0.5))
        want["elevator"] = (
            self.a.trim["elevator"]
            + self.sum["elevator"]
            + float(np.clip(-1.4 * error + 1.2 * now["q"], -0.4, 0.4))
        )

    def speeds(self) -> None:
        error = self.speed - self.airspeed()
        self.sum["throttle"] = float(
            np.clip(self.sum["throttle"] + 0.004 * error / RATE, -0.5, 0.5)
        )
        self.a.want["throttle"] = float(
            np.clip(self.a.trim["throttle"] + self.sum["throttle"] + 0.05 * error, 0.0, 1.0)
        )

    def holds(self, _t: float = 0.0) -> None:
        """Hold everything."""
        self.laterally(), self.vertically(), self.speeds()


def fly(kcas: float, altitude: float, cards: list[tuple]) -> pd.DataFrame:
    """Fly the cards of one run in calm air and return its motion, error-free."""
    # the trim of the simulation does not wait for the governor: the pilot finds the speed
    a = Aeroplane(TRIMMED, altitude)
    pilot = Pilot(a)
    pilot.speed *= kcas / TRIMMED

    def during(seconds: float, action: Action) -> None:
        for k in range(round(seconds * RATE)):
            action(k / RATE)
            a.step()

    def free(seconds: float) -> None:
        during(seconds, lambda t: None)

    during(SETTLING, pilot.holds)
    del a.rows[:-1]
    a.trim = dict(a.want)
    pilot = Pilot(a)
    for kind, *values in cards:
        start = dict(a.want)
        if kind == "free":
            free(values[0])
        elif kind == "hold":
            during(values[0], pilot.holds)
        # control, amplitude, unit of time, signs in units of time, seconds after
        elif kind == "steps":
            control, size, unit, signs, after = values
            for sign, units in signs:
                a.want[control] = start[control] + sign * size
                free(units * unit)
            a.want[control] = start[control]
            free(after)
        elif kind == "lever":  # to, seconds
            a.want["throttle"] = values[0]
            free(values[1])
        elif kind == "pull_push":
            size, seconds = values

            def pull_push(
                t: float,
                size: float = size,
                seconds: float = seconds,
                start: dict[str, float] = start,
            ) -> None:
                pilot.laterally()
                a.want["elevator"] = start["elevator"] - size * float(
                    np.sin(2 * np.pi * t / seconds)
                )

            during(seconds, pull_push)
        # lever, bank, angle of attack at the top, seconds up, at the top, down, after
        elif kind == "stall":
            lever, bank, top, *seconds = values
            times = np.cumsum([0.0, *seconds])
            first, held = float(np.arctan2(a.now["w"], a.now["u"])), [0.0]

            def stall(t: float, top: float = top, bank: float = bank) -> None:
                # a hand that follows an angle of attack, with a shake that moves it about
                pilot.laterally(bank * float(np.clip(t / 4.0, 0.0, 1.0)))
                wanted = float(np.interp(t, times[:4], [first, top, top, first])) + 0.012 * float(
                    np.sin(2.0 * np.pi * 0.7 * t)
                )
                error = wanted - float(np.arctan2(a.now["w"], a.now["u"]))
                held[0] -= 0.8 * error / RATE
                a.want["elevator"] = start["elevator"] + held[0] - 1.6 * error + 0.5 * a.now["q"]

            a.want["throttle"] = lever
            during(float(times[-1]), stall)
            a.want["throttle"] = a.trim["throttle"]
        elif kind == "sideslip":
            size, seconds = values

            def sideslip(t: float, size: float = size, seconds: float = seconds) -> None:
                pilot.holds()
                now = a.now
                bank = float(
                    np.clip(
                        2.0 * ((pilot.psi - now["psi"] + np.pi) % (2 * np.pi) - np.pi), -0.25, 0.25
                    )
                )
                pilot.laterally(bank)
                a.want["rudder"] = a.trim["rudder"] + size * float(
                    np.clip(t / 2.5, 0, 1) * np.clip((seconds - t) / 1.5, 0, 1)
                )

            during(seconds, sideslip)
        else:
            raise ValueError(kind)
    return pd.DataFrame(a.rows)


def measured(motion: pd.DataFrame, wind: np.ndarray, seed: int) -> pd.DataFrame:
    """Return what the recorder holds: the motion at the instruments, with their errors, in the
    units of the columns.

    A steady wind (north, east) [kt] carries the aeroplane along: it adds to the ground speed and
    changes nothing else.
    """
    rng = np.random.default_rng([182, seed])
    m = {name: motion[name].to_numpy() for name in motion}
    time = np.arange(len(motion)) / RATE
    omega, omega_dot = (np.stack([m[n + tail] for n in "pqr"], 1) for tail in ("", "_dot"))
    cg = np.stack([m["x_cg"], 0 * time, m["z_cg"]], 1)
    arm = IMU - cg
    force = (
        np.stack([m["ax"], m["ay"], m["az"]], 1)
        + np.cross(omega_dot, arm)
        + np.cross(omega, np.cross(omega, arm))
    )
    air = np.stack([m["u"], m["v"], m["w"]], 1) + np.cross(omega, VANES - cg)

    def behind(x: np.ndarray) -> np.ndarray:
        keep = np.exp(-1.0 / (RATE * VANE_LAG))
        y = x.copy()
        for i in range(1, len(x)):  # exact for an input that is linear between records
            slope = (x[i] - x[i - 1]) * RATE * VANE_LAG
            y[i] = x[i] - slope + (y[i - 1] - x[i - 1] + slope) * keep
        return y

    speed = np.linalg.norm(air, axis=1)
    mach = m["mach"] * speed / np.sqrt(m["u"] ** 2 + m["v"] ** 2 + m["w"] ** 2)
    q_c = m["p_static"] * ((1 + 0.2 * mach**2) ** 3.5 - 1)
    static, impact = m["p_static"] + POSITION_ERROR * q_c, q_c * (1 - POSITION_ERROR)
    x = {
        "cas": np.sqrt(5 * 1.4 * 287.05287 * 288.15 * ((impact / 101325 + 1) ** (2 / 7) - 1)) / KT,
        "altitude": 288.15 / 0.0065 * (1 - (static / 101325) ** (287.05287 * 0.0065 / G0)) / FT,
        "oat": m["temperature"] - 273.15,
        "alpha": behind(np.arctan2(air[:, 2], air[:, 0])) / DEG,
        "beta": behind(np.arctan2(air[:, 1], air[:, 0])) / DEG,
        "psi": np.unwrap(m["psi"]) / DEG,
        "nx": force[:, 0] / G0,
        "ny": force[:, 1] / G0,
        "nz": -force[:, 2] / G0,
        "lever": 100 * m["lever"],
        "prop_lever": 100 * m["prop_lever"],
        "rpm": m["rpm"],
        "map": m["map"] / INHG,
        "vn": m["vn"] / KT + wind[0],
        "ve": m["ve"] / KT + wind[1],
        "vs": -m["vd"] / FT * 60,
        "gps": m["h"] / FT,
        "weight": m["mass"] / LB,
        "station": STATION - m["x_cg"] / INCH,
    }
    x |= {
        name: m[name] / DEG
        for name in ("phi", "theta", "p", "q", "r", "elevator", "aileron", "rudder")
    }
    for name in x:
        x[name] = np.interp(time - DELAY.get(name, 0.0), time, x[name]) * FACTOR.get(
            name, 1.0
        ) + BIAS.get(name, 0.0)
        x[name] += rng.normal(0.0, NOISE.get(name, 0.0), len(time))
    x["psi"] %= 360.0
    x["time"] = time
    return pd.DataFrame(
        {heading: np.round(x[name], digits) for heading, (name, digits) in COLUMNS.items()}
    )


STEPS_3211 = [(1, 3), (-1, 2), (1, 1), (-1, 1)]
DOUBLET = [(1, 1), (-1, 1)]


def test_point(a: float) -> list[tuple]:
    """Return the card of one speed; `a` scales the inputs."""
    return [
        ("free", 5.0),
        ("steps", "elevator", 0.14 * a, 0.5, STEPS_3211, 5.0),
        ("hold", 10.0),
        ("steps", "elevator", 0.14 * a, 0.8, DOUBLET, 4.0),
        ("hold", 8.0),
        ("steps", "aileron", 0.25 * a, 0.7, STEPS_3211, 3.0),
        ("hold", 10.0),
        ("steps", "rudder", 0.30 * a, 1.0, DOUBLET, 10.0),
        ("hold", 10.0),
        ("pull_push", 0.12 * a, 8.0),
        ("hold", 8.0),
        ("sideslip", 0.35, 9.0),
        ("sideslip", -0.35, 9.0),
        ("hold", 12.0),
        ("lever", 0.25, 8.0),
        ("hold", 12.0),
        ("lever", 1.0, 7.0),
    ]


# name: calibrated airspeed [kt], height [ft], cards
PROGRAMME = {
    "slow": (75.0, 5000.0, test_point(1.3)),
    "cruise": (100.0, 5000.0, test_point(1.0)),
    "fast": (112.0, 5000.0, test_point(0.8)),
    "check_short_period": (
        95.0,
        6000.0,
        [("free", 5.0), ("steps", "elevator", 0.12, 1.0, DOUBLET, 10.0)],
    ),
    "check_phugoid": (
        100.0,
        6000.0,
        [("free", 5.0), ("steps", "elevator", 0.06, 3.0, [(-1, 1)], 90.0)],
    ),
    "check_roll": (90.0, 6000.0, [("free", 5.0), ("steps", "aileron", 0.4, 2.5, [(1, 1)], 5.0)]),
    "check_dutch_roll": (
        95.0,
        6000.0,
        [("free", 5.0), ("steps", "rudder", 0.35, 0.9, DOUBLET, 15.0)],
    ),
    "check_power": (100.0, 6000.0, [("free", 6.0), ("lever", 0.25, 20.0)]),
}
# stalls: quasi-steady and accelerated ones identify, the last two prove
STALLS = {
    "stall_quasi_steady": (
        72.0,
        6500.0,
        [("free", 4.0), ("stall", 0.0, 0.0, 20 * DEG, 26.0, 2.0, 4.0, 2.0)],
    ),
    "stall_accelerated": (
        75.0,
        6500.0,
        [("free", 4.0), ("stall", 0.2, 0.0, 20 * DEG, 5.0, 1.5, 3.0, 2.0)],
    ),
    "stall_turning": (
        75.0,
        6500.0,
        [("free", 4.0), ("stall", 0.3, -30 * DEG, 20 * DEG, 9.0, 1.5, 3.0, 2.0)],
    ),
    "check_stall": (
        72.0,
        6000.0,
        [("free", 4.0), ("stall", 0.0, 0.0, 19 * DEG, 30.0, 1.0, 5.0, 3.0)],
    ),
    "check_stall_turn": (
        75.0,
        6000.0,
        [("free", 4.0), ("stall", 0.15, 30 * DEG, 20 * DEG, 14.0, 1.0, 4.0, 2.5)],
    ),
}


def main(folder: Path, programme: dict[str, tuple], first: int = 0) -> None:
    """Write a CSV for each run of a programme; `first` is the number of the first run."""
    folder.mkdir(exist_ok=True)
    winds = np.random.default_rng(182 + first).uniform(-9.0, 9.0, (len(programme), 2))  # [kt]
    for number, ((name, (kcas, altitude, cards)), wind) in enumerate(
        zip(programme.items(), winds), first
    ):
        motion = fly(kcas, altitude, cards)
        measured(motion, wind, number).to_csv(
            folder / f"{name}.csv", index=False, float_format="%.7g"
        )
        print(f"{name:20s} {len(motion) / RATE:6.1f} s")


if __name__ == "__main__":
    here = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    here.mkdir(exist_ok=True)
    main(here / "flight", PROGRAMME)
    main(here / "stall", STALLS, len(PROGRAMME))
