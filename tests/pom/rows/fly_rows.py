"""Fly the manoeuvres of the tolerance table that no record of ``data/t37/flight`` holds, with the
T37 of JSBSim.

``python tests/pom/rows/fly_rows.py [NAME ...]`` writes ``flights/NAME.nc``: error-free states by
canonical name, in SI.  The aeroplane, its pilot and the cards are those of
``../shared/tools/t37_flight_test.py``; nothing of the aircraft files of JSBSim is copied, only the
recordings are ours.  Tests read the files and need neither JSBSim nor ``../shared``.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

import numpy as np
import xarray as xr

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[3] / "shared" / "tools"))

import t37_flight_test as T  # noqa: E402  (a tool that is not a part of the repository)
from t37_ground_handling import drive, roll_up, steps, still, straight  # noqa: E402

FLAP = np.radians(40.0)  # full flap, as in data/t37/names.toml
AHEAD = np.radians(T.HEADING)
QUIET = {"noise_seed": 1, "day_temperature_offset": 6.0}
REVERSED = np.radians(130.0)  # of the thrust vector: cascades that turn the jet forward
STEERED = 0.25  # nose-wheel angle per rudder deflection of the flight `pedal_steering`
NOSE_WHEEL = np.radians(5.0)  # nose-wheel angle of a full command
GEARING = -4.4  # [rad/m] rudder per pedal travel, of data/t37/apriori.toml
EXACT = {"h", "h_agl", "p_static", "vn", "ve", "psi"}  # kept as float32, the others to 1 in 30 000
SLOW = (
    "climb",
    "acceleration",
    "deceleration",
    "descent",
    "roll_out",
    "taxi",
    "minimum",
    "stall",
    "stop",
)  # flights kept at 10 Hz


class Equipped(T.Aeroplane):
    """The aeroplane with engines of their own, thrust reversers, wind that depends on height, a
    runway that is not dry.
    """

    def __init__(self, run: dict, errors: dict):
        self.power = [1.0, 1.0]
        self.shear = lambda height: np.zeros(3)
        super().__init__(run, errors)
        for name, value in run.get("runway", {}).items():
            for leg in ("gear/unit[1]", "gear/unit[2]"):
                self.f[f"{leg}/{name}"] = value

    def _wind(self) -> None:
        height = self.f["position/h-sl-ft"] * T.FT - T.RUNWAY
        total = self.wind + self.gust + self.shear(height)
        self.blowing = total
        for axis, value in zip(("north", "east", "down"), total, strict=True):
            self.f[f"atmosphere/wind-{axis}-fps"] = value / T.FT

    def advance(self, gust: np.ndarray) -> None:
        f, dt = self.f, 1.0 / (T.RATE * T.FRAMES)
        self.gust = gust
        for _ in range(T.FRAMES):
            self._wind()
            for name, prop in self.COMMAND.items():
                step = np.clip(
                    (self.want[name] - self.have[name]) * dt / 0.045,
                    -self.SLEW * dt,
                    self.SLEW * dt,
                )
                self.have[name] += float(step)
                f[prop] = self.have[name]
            self.have["throttle"] += float(
                np.clip(self.want["throttle"] - self.have["throttle"], -1.6 * dt, 1.6 * dt)
            )
            for i, share in enumerate(self.power):
                f[f"fcs/throttle-cmd-norm[{i}]"] = self.have["throttle"] * share
            f.run()
        self.position += (
            np.array([f["velocities/v-north-fps"], f["velocities/v-east-fps"]]) * T.FT / T.RATE
        )

    def fail(self, engine: int) -> None:
        """Cut the fuel of an engine; it windmills."""
        self.f["propulsion/active_engine"] = engine
        self.f["propulsion/cutoff_cmd"] = 1
        self.f["propulsion/active_engine"] = -1

    def reverse(self, *engines: int) -> None:
        for i in (0, 1):
            self.f[f"propulsion/engine[{i}]/reverser-angle-rad"] = REVERSED if i in engines else 0.0

    def read(self) -> dict:
        d = super().read()
        d["delta_nw"] = np.radians(self.f["fcs/steer-pos-deg"])
        d["brake_left"], d["brake_right"] = (
            self.f["fcs/left-brake-cmd-norm"],
            self.f["fcs/right-brake-cmd-norm"],
        )
        d["wind_north"], d["wind_east"], d["wind_down"] = self.blowing
        return d


def script(what, length, law, prepare=None):
    """Return a card: ``law(aeroplane, pilot, t, reading, first)`` sets what it moves; ``first`` is
    the reading at its start.
    """

    def start(a, pilot, d):
        if prepare is not None:
            prepare(a, pilot, d)
        first = {**d, "want": dict(a.want), "e_int": pilot.e_int}
        return lambda t, d: law(a, pilot, t, d, first)

    return ("script", what, "", length, start, "")


def ramp(t, start, length):
    return float(np.clip((t - start) / length, 0.0, 1.0))


def pitch(change=0.0, over=3.0, throttle=None, bank=0.0, speed=None):
    """Hold the pitch attitude of the start plus a change; wings at a bank; the lever where it is,
    or where it is wanted.
    """

    def law(a, pilot, t, d, first):
        pilot.longitudinal(d, theta=first["theta"] + change * ramp(t, 0.0, over))
        pilot.lateral(d, phi=bank * ramp(t, 0.0, 3.0))
        if throttle is not None:
            a.want["throttle"] = throttle
        if speed is not None:
            pilot.speed(d, speed)

    return law


def approach_to_stall(change, over, held, throttle):
    """Raise the nose by `change` over some seconds, hold it and lower it in 4 s; levers fixed."""

    def law(a, pilot, t, d, first):
        raised = ramp(t, 0.0, over) - ramp(t, over + held, 4.0)
        pilot.longitudinal(d, theta=first["theta"] + change * raised)
        pilot.lateral(d, phi=0.0)
        a.want["throttle"] = throttle

    return law


def level(throttle=None, bank=None):
    def law(a, pilot, t, d, first):
        pilot.height(d, first["h"])
        pilot.lateral(d, phi=bank, psi=AHEAD)
        if throttle is None:
            pilot.speed(d, first["V"])
        else:
            a.want["throttle"] = throttle

    return law


def one_engine(law, foot=0.9):
    """Fly a law with the left engine dead: the rudder follows the yaw rate and the heading, the
    dead engine slightly high.
    """

    def more(a, pilot, t, d, first):
        law(a, pilot, t, d, first)
        error = (np.radians(T.HEADING) - d["psi"] + np.pi) % (2 * np.pi) - np.pi
        pilot.foot = float(
            np.clip(
                getattr(pilot, "foot", 0.0) + foot * (-error + 1.5 * d["r"]) / T.RATE, -0.8, 0.8
            )
        )
        a.want["rudder"] = float(np.clip(pilot.foot - 1.5 * error + 1.5 * d["r"], -1.0, 1.0))
        pilot.lean = float(
            np.clip(getattr(pilot, "lean", 0.0) - 0.2 * d["phi"] / T.RATE, -0.5, 0.5)
        )
        a.want["aileron"] = float(np.clip(pilot.lean - 0.9 * d["phi"] - 0.35 * d["p"], -0.6, 0.6))

    return more


def free(after):
    """Let go of the controls; `after(a, t)` moves something else."""

    def law(a, pilot, t, d, first):
        if t == 0.0:
            pilot.let_go()
        after(a, t)

    return law


def pulses(control, size, sign=1.0):
    """A small step of a control and back, the other controls where they are."""

    def law(a, pilot, t, d, first):
        a.want[control] = first["want"][control] + sign * size * (1.0 if 5.0 <= t < 7.0 else 0.0)

    return law


def take_off(v_rotate, theta, length, fail_at=None, drift=0.0):
    """Roll, rotate and climb; the left engine fails at a speed [m s-1] when one is given."""

    def law(a, pilot, t, d, first):
        if t == 0.0:
            a.gone = a.rotated = False
            pilot.e_int = 0.0
        a.f["fcs/left-brake-cmd-norm"] = a.f["fcs/right-brake-cmd-norm"] = 0.0
        a.want["throttle"] = 1.0
        if fail_at is not None and d["V"] > fail_at and not a.gone:
            a.gone = True
            a.fail(0)
        error = (np.radians(T.HEADING) - d["psi"] + np.pi) % (2 * np.pi) - np.pi
        if not a.rotated:
            wanted = straight(d)
            a.f["fcs/steer-cmd-norm"] = float(np.clip(wanted["steer"], -1, 1))
            a.want["rudder"] = float(np.clip(wanted["rudder"], -0.9, 0.9))
            a.want["aileron"] = float(np.clip(-1.2 * d["phi"] - 0.35 * d["p"], -0.5, 0.5))
            a.want["elevator"] = 0.0
            a.rotated, a.aim = d["V"] > v_rotate, d["theta"]
        else:
            a.f["fcs/steer-cmd-norm"] = 0.0
            a.aim = min(theta, a.aim + 0.055 / T.RATE)
            pilot.longitudinal(d, theta=a.aim, relax=0.6)
            a.want["aileron"] = float(np.clip(-1.2 * d["phi"] - 0.4 * d["p"], -0.6, 0.6))
            pilot.foot = (
                float(np.clip(getattr(pilot, "foot", 0.0) - 0.6 * error / T.RATE, -0.8, 0.8))
                if a.gone
                else 0.0
            )
            a.want["rudder"] = (
                float(np.clip(pilot.foot - 1.5 * error + 1.6 * d["r"], -1.0, 1.0))
                if a.gone or d["h_agl"] < 2.0
                else 0.8 * d["r"]
            )

    return script("takeoff", length, law)


def stop(left, right, length, throttle=0.0, reverse=(), steer=True, cut=False):
    """Roll out with brakes, reversers and idle or more power."""

    def law(a, pilot, t, d, first):
        if t == 0.0:
            a.reverse(*reverse)
            for engine in (0, 1) if cut else ():
                a.fail(engine)
        a.want["throttle"] = throttle if d["V"] > 18.0 or not reverse else 0.0
        on = ramp(t, 0.0, 0.5)
        a.f["fcs/left-brake-cmd-norm"], a.f["fcs/right-brake-cmd-norm"] = left * on, right * on
        a.want["elevator"] = 0.0
        wanted = straight(d)
        a.f["fcs/steer-cmd-norm"] = float(np.clip(wanted["steer"], -1, 1)) if steer else 0.0
        a.want["rudder"] = float(np.clip(wanted["rudder"], -1, 1)) if steer else 0.0
        a.want["aileron"] = float(np.clip(-0.9 * d["phi"] - 0.35 * d["p"], -0.4, 0.4))

    return script("roll_out", length, law)


def pedals(length):
    """Sweep the pedals to both sides while the aeroplane rolls; the nose wheel follows the
    rudder.
    """

    def law(a, pilot, t, d, first):
        a.want["rudder"] = (
            0.8 * np.sin(2.0 * np.pi * t / (length - 2.0)) if t < length - 2.0 else 0.0
        )
        a.want["throttle"] = float(np.clip(0.25 * (4.0 - d["V"]) + 0.12, 0, 1))
        a.f["fcs/steer-cmd-norm"] = float(-STEERED * d["delta_r"] / a.steered_by)

    return script(
        "pedal_sweep", length, law, prepare=lambda a, pilot, d: setattr(a, "steered_by", NOSE_WHEEL)
    )


def go_around(change, length, dead=False):
    def law(a, pilot, t, d, first):
        a.want["throttle"] = 1.0
        if t >= 2.0 and d["gear"] > 0.5:
            a.devices(flaps=0.5)
        pilot.longitudinal(d, theta=first["theta"] + change * ramp(t, 0.0, 4.0))
        pilot.lateral(d, phi=0.0)

    return script("go_around", length, one_engine(law) if dead else law)


def air(kcas, altitude, cards, flaps=0.0, gear=0.0, **more):
    return T.single(1, "", kcas, altitude, cards, flaps, gear, **more)


def ground(cards, flaps=0.5, **more):
    return T.single(1, "", 0.0, 0.0, [still(3.0), *cards], flaps, 1.0, start="ground", **more)


def power_up(length=7.0):
    return drive(
        "power_up",
        "throttle",
        length,
        lambda t, d: {"throttle": min(1.0, 0.25 * t), "left": 1.0, "right": 1.0},
        "",
    )


def approach(cards, height=66.0, kcas=97.0, flaps=1.0, **more):
    return T.single(1, "", kcas, 0.0, cards, flaps, 1.0, start="glide", height=height, **more)


def landing(height=66.0):
    return ("landing", height, 3.0, 60.0)


def cut(a, pilot, d):
    a.fail(0)


def settle(length=25.0, law=None):
    """Fly on one engine until the pilot has settled."""
    return script("settle", length, one_engine(law or level()), prepare=cut)


WET = {"static_friction_coeff": 0.4, "dynamic_friction_coeff": 0.3}
ICY = {"static_friction_coeff": 0.035, "dynamic_friction_coeff": 0.035}

FLIGHTS = {
    "pedal_steering": (ground([roll_up(4.0, 8.0), pedals(24.0)], 0.0), {}),
    "taxi_circle": (ground([roll_up(3.0, 8.0), steps(3.0, [0.8], 30.0)], 0.0), {}),
    "take_off": (ground([power_up(), take_off(38.0, 0.15, 40.0)]), {}),
    "engine_failure_on_ground": (ground([power_up(), take_off(60.0, 0.1, 24.0, fail_at=34.0)]), {}),
    "engine_failure_at_take_off": (
        ground([power_up(), take_off(47.0, 0.12, 45.0, fail_at=46.0)]),
        {},
    ),
    "crosswind_take_off": (ground([power_up(), take_off(45.0, 0.15, 40.0)]), {"wind": (7.5, 0.0)}),
    "engine_failure_after_take_off": (
        air(
            125.0,
            1500.0,
            [
                ("trim", 3.0),
                script("full_power", 6.0, pitch(0.02, throttle=1.0)),
                script(
                    "failure", 12.0, free(lambda a, t: a.fail(0) if abs(t - 5.5) < 0.01 else None)
                ),
            ],
            0.5,
        ),
        {},
    ),
    "climb": (
        air(180.0, 4000.0, [("trim", 3.0), script("climb", 40.0, pitch(0.10, throttle=0.95))]),
        {},
    ),
    "climb_one_engine_flaps_half": (
        air(
            120.0,
            2000.0,
            [settle(), script("climb", 60.0, one_engine(pitch(0.05, throttle=1.0)))],
            0.5,
        ),
        {},
    ),
    "climb_one_engine_clean": (
        air(
            150.0, 4000.0, [settle(), script("climb", 60.0, one_engine(pitch(0.05, throttle=1.0)))]
        ),
        {},
    ),
    "acceleration": (
        air(130.0, 5000.0, [("trim", 3.0), script("acceleration", 60.0, level(1.0))]),
        {},
    ),
    "deceleration": (
        air(230.0, 5000.0, [("trim", 3.0), script("deceleration", 55.0, level(0.0))]),
        {},
    ),
    "cruise": (air(200.0, 10000.0, [("trim", 12.0)]), {}),
    "idle_descent": (
        air(170.0, 9000.0, [("trim", 3.0), script("descent", 50.0, pitch(-0.12, throttle=0.0))]),
        {},
    ),
    "emergency_descent": (
        air(
            200.0,
            18000.0,
            [
                ("trim", 3.0),
                script(
                    "descent",
                    55.0,
                    pitch(-0.28, 6.0, throttle=0.0),
                    lambda a, p, d: a.devices(speedbrake=1.0),
                ),
            ],
        ),
        {},
    ),
    "landing_stop": (approach([landing(), stop(0.5, 0.5, 20.0)]), {}),
    "landing_stop_wet": (approach([landing(), stop(1.0, 1.0, 25.0)], runway=WET), {}),
    "landing_stop_icy": (approach([landing(), stop(1.0, 1.0, 90.0, cut=True)], runway=ICY), {}),
    "roll_out_reversers": (
        ground([roll_up(42.0, 26.0), stop(0.0, 0.0, 30.0, 0.7, (0, 1))], 1.0),
        {},
    ),
    "roll_out_one_reverser": (
        ground([roll_up(42.0, 26.0), stop(0.0, 0.0, 30.0, 0.4, (0,))], 1.0),
        {},
    ),
    "lever_chop_and_slam": (
        air(150.0, 6000.0, [("trim", 4.0), ("lever", 0.0, 0.4, 10.0), ("lever", 0.98, 0.4, 14.0)]),
        {},
    ),
    "lever_slam": (air(115.0, 3000.0, [("trim", 4.0), ("lever", 0.98, 0.4, 14.0)], 0.5, 1.0), {}),
    "small_pitch_input": (
        air(160.0, 8000.0, [("trim", 4.0), script("step", 13.0, pulses("elevator", 0.03))]),
        {},
    ),
    "small_roll_input": (
        air(160.0, 8000.0, [("trim", 4.0), script("step", 13.0, pulses("aileron", 0.008))]),
        {},
    ),
    "small_yaw_input": (
        air(160.0, 8000.0, [("trim", 4.0), script("step", 13.0, pulses("rudder", 0.06))]),
        {},
    ),
    "speed_brake": (
        air(180.0, 6000.0, [("trim", 5.0), ("device_free", "speedbrake", 1.0, 22.0)]),
        {},
    ),
    "stall": (
        air(
            120.0, 10000.0, [("trim", 3.0), script("stall", 45.0, pitch(0.24, 30.0, throttle=0.0))]
        ),
        {},
    ),
    "stall_approach": (
        air(
            105.0,
            10000.0,
            [
                ("trim", 3.0),
                script("stall", 40.0, approach_to_stall(0.165, 26.5, 0.5, throttle=0.5)),
            ],
        ),
        {},
    ),
    "minimum_control_speed": (
        air(
            110.0,
            4000.0,
            [settle(), script("deceleration", 40.0, one_engine(pitch(0.20, 25.0, throttle=1.0)))],
            0.5,
        ),
        {},
    ),
    "roll_step": (air(160.0, 6000.0, [("trim", 4.0), ("block", "aileron", 0.10, 2.0, 11.0)]), {}),
    "one_engine_trim": (
        air(165.0, 5000.0, [settle(35.0), script("trim", 10.0, one_engine(level()))]),
        {},
    ),
    "steady_sideslip": (
        air(120.0, 3000.0, [("trim", 3.0), ("sideslip", 0.40, 16.0)], 1.0, 1.0),
        {},
    ),
    "landing_flaps_up": (approach([landing()], kcas=112.0, flaps=0.0), {}),
    "crosswind_landing": (approach([landing()]), {"wind": (5.5, 0.0)}),
    "one_engine_landing": (
        approach(
            [
                settle(5.0, pitch(-0.04, speed=50.0)),
                script("approach", 14.0, one_engine(pitch(-0.012, speed=50.0))),
            ],
            80.0,
            flaps=0.5,
        ),
        {},
    ),
    "go_around": (approach([("glide", 66.0, 3.0, 14.0), go_around(0.10, 14.0)]), {}),
    "one_engine_go_around": (
        approach(
            [settle(8.0, pitch(-0.02, speed=52.0)), go_around(0.06, 14.0, True)], 80.0, 100.0, 0.5
        ),
        {},
    ),
    "low_pass": (
        T.single(1, "", 98.0, 0.0, [("pass", 2.6, 10.0, 0.0)], 1.0, 1.0, start="pass", height=2.6),
        {},
    ),
    "wind_shear_take_off": (
        ground([power_up(), take_off(45.0, 0.14, 40.0)]),
        {
            "shear": lambda height: np.array(
                [0.0, -8.0 + 16.0 * np.clip((height - 5.0) / 45.0, 0.0, 1.0), 0.0]
            )
        },
    ),
    "pull_up": (air(200.0, 8000.0, [("trim", 3.0), ("pupd", 0.13, 10.0)]), {}),
}


def fly(name: str) -> xr.Dataset:
    """Return the error-free states of a flight by canonical name. [SI]"""
    run, more = FLIGHTS[name]
    errors = {**QUIET, "wind_north_east": {"01": [0.0, 0.0]}}

    def aeroplane(run: dict, errors: dict) -> Equipped:
        a = Equipped(run, errors)
        a.wind = np.array([*more.get("wind", (0.0, 0.0)), 0.0])
        a.shear = more.get("shear", a.shear)
        return a

    truth, _ = T.fly(run, errors, aeroplane)
    return canonical(truth)


def canonical(truth: dict[str, np.ndarray]) -> xr.Dataset:
    same = "p q r phi theta psi u v w V alpha beta vn ve vd h mass p_static temperature"
    same += " delta_e delta_r delta_nw gear speedbrake brake_left brake_right"
    found = {name: truth[name] for name in f"{same} wow_nose wow_left wow_right".split()}
    found |= {
        "delta_a": 0.5 * (truth["delta_a_right"] - truth["delta_a_left"]),
        "delta_f": FLAP * truth["flap"],
    }
    found |= {f"{axis}_cg_b": truth[f"{axis}_cg"] for axis in "xyz"}
    found |= {
        "wind_n": truth["wind_north"],
        "wind_e": truth["wind_east"],
        "wind_d": truth["wind_down"],
    }
    down = (
        -np.sin(truth["theta"]) * truth["x_cg"]
        + np.cos(truth["theta"]) * np.cos(truth["phi"]) * truth["z_cg"]
    )
    found |= {
        "h_agl": truth["h"] - T.RUNWAY + down,
        "hdot": -truth["vd"],
        "nz": -truth["az"] / T.G0,
    }
    q_c = truth["p_static"] * ((1.0 + 0.2 * truth["mach"] ** 2) ** 3.5 - 1.0)
    found["V_cas"] = np.sqrt(
        1.4 * 287.05287 * 288.15 * 5.0 * ((q_c / 101325.0 + 1.0) ** (2.0 / 7.0) - 1.0)
    )
    found |= {"gear.steering": truth["delta_nw"], "pedal": truth["delta_r"] / GEARING}
    found["gamma"] = np.arctan2(-truth["vd"], np.hypot(truth["vn"], truth["ve"]))
    for i, side in ((1, "left"), (2, "right")):
        found |= {
            f"engine{i}.{name}": truth[f"{name}_{side}"]
            for name in ("throttle", "thrust", "n1", "fuel_flow")
        }
    return xr.Dataset(
        {name: ("time", np.asarray(y, float)) for name, y in found.items()},
        coords={"time": np.round(truth["time"], 6)},
    )


def used(name: str) -> tuple[float, float]:
    """Return the stretch of a flight that the cases replay, and a second on both sides. [s]"""
    cases = [
        tomllib.loads(file.read_text(encoding="utf-8"))["case"]
        for folder in ("cases", "stall_rows")
        for file in (HERE / folder).glob("*.toml")
    ]
    windows = [case["window"] for case in cases if Path(case["record"]).stem == name]
    return min(start for start, _ in windows) - 1.0, max(stop for _, stop in windows) + 1.0


def write(name: str) -> None:
    states = fly(name)
    states = states.sel(time=slice(*used(name)))
    states = states.isel(time=slice(None, None, 5 if any(word in name for word in SLOW) else 2))
    packed = {
        str(key): (
            "time",
            item.values.astype("float32") if key in EXACT else T.keep_bits(item.values, 14),
        )
        for key, item in states.data_vars.items()
    }
    kept = xr.Dataset(
        packed,
        coords=states.coords,
        attrs={"source": f"{name}: the T37 of JSBSim 1.3.3, error-free states"},
    )
    settings = {"zlib": True, "shuffle": True, "complevel": 9, "chunksizes": (kept.sizes["time"],)}
    kept.to_netcdf(
        HERE / "flights" / f"{name}.nc",
        engine="h5netcdf",
        encoding={key: settings for key in kept.variables},
    )
    spans = (
        ("V", 1.0),
        ("h_agl", 1.0),
        ("alpha", 57.3),
        ("beta", 57.3),
        ("phi", 57.3),
        ("psi", 57.3),
        ("engine1.thrust", 1.0),
    )
    shown = "  ".join(
        f"{key} {states[key].values.min() * k:.1f}..{states[key].values.max() * k:.1f}"
        for key, k in spans
    )
    print(f"{name:32s} {float(states['time'][-1]):6.1f} s  {shown}", flush=True)


if __name__ == "__main__":
    (HERE / "flights").mkdir(exist_ok=True)
    for name in sys.argv[1:] or FLIGHTS:
        write(name)
