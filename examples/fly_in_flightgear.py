"""Fly the T-37 of ``data/t37`` by hand, with FlightGear as cockpit and window: a pilot's look at
the a-priori model (LR-743, section 3.5).

    fgfs --fdm=null --native-fdm=socket,in,60,,5500,udp
    --native-ctrls=socket,out,60,127.0.0.1,5501,udp python examples/fly_in_flightgear.py [--database
    FILE.nc] [--lat DEG] [--lon DEG] [--height M] [--speed KT] [--runway M]

FlightGear sends the positions of stick, pedals, levers and brakes; the model answers 60 times a
second, in real time, with the motion of the aeroplane.  Any program that speaks FlightGear's native
protocol can stand in its place.  The flight starts trimmed and level; stick and elevator trim move
the surfaces from there, the lever is absolute.  Digital DATCOM knows no rudder: in the air the
a-priori model has no answer to the pedals, one identified from flight (``--database
out/t37/final.nc`` of ``aeromatch demo``) has.  Ctrl-C ends it.

Layout of the messages: ``net_fdm.hxx`` (version 24) and ``net_ctrls.hxx`` (version 27) of
FlightGear, numbers in network byte order.
"""

# %% The messages

from __future__ import annotations

import argparse
import itertools
import socket
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import aerodb
import flightmech
from aeromatch.project.project import read_project
from aeromatch.workflow.aerodynamics import a_priori
from flightmech.simulation.kernel import INPUT, Simulation
from flightmech.simulation.run import index_of_parameter

DATA = Path(__file__).parents[1] / "data" / "t37"
DEG, KT, FT = np.pi / 180.0, 1852.0 / 3600.0, 0.3048
GALLON = 6.5 * 0.45359237  # of JP-4 [kg]
RATE = 60.0  # messages a second
LATE = 0.25  # the longest time that is caught up with [s]

# name: struct code; "x" is a gap that the C compiler leaves before a double
AEROPLANE = {
    "version": "I",
    "padding": "I",
    **dict.fromkeys(("longitude", "latitude", "altitude"), "d"),  # geodetic [rad], [m]
    **dict.fromkeys(
        ("agl", "phi", "theta", "psi", "alpha", "beta", "phidot", "thetadot", "psidot"), "f"
    ),  # [m], [rad], [rad/s]
    **dict.fromkeys(
        ("vcas", "climb_rate", "v_north", "v_east", "v_down", "v_body_u", "v_body_v", "v_body_w"),
        "f",
    ),  # [kt], [ft/s]
    **dict.fromkeys(("A_X_pilot", "A_Y_pilot", "A_Z_pilot"), "f"),  # [ft/s2]
    **dict.fromkeys(("stall_warning", "slip_deg"), "f"),
    **{"num_engines": "I", "eng_state": "4I"},  # 0 off, 1 cranking, 2 running
    **{
        "rpm": "4f",
        "fuel_flow": "4f",
        "fuel_px": "4f",
        "egt": "4f",
        "cht": "4f",
        "mp_osi": "4f",
        "tit": "4f",
        "oil_temp": "4f",
        "oil_px": "4f",
    },
    **{"num_tanks": "I", "fuel_quantity": "4f"},
    **{
        "num_wheels": "I",
        "wow": "3I",
        "gear_pos": "3f",
        "gear_steer": "3f",
        "gear_compression": "3f",
    },
    **{"cur_time": "I", "warp": "i", "visibility": "f"},
    **dict.fromkeys(
        (
            "elevator",
            "elevator_trim_tab",
            "left_flap",
            "right_flap",
            "left_aileron",
            "right_aileron",
        ),
        "f",
    ),  # -1 to 1
    **dict.fromkeys(("rudder", "nose_wheel", "speedbrake", "spoilers"), "f"),
}
CONTROLS = {
    "version": "I4x",
    **dict.fromkeys(
        ("aileron", "elevator", "rudder", "aileron_trim", "elevator_trim", "rudder_trim"), "d"
    ),  # -1 to 1
    **dict.fromkeys(("flaps", "spoilers", "speedbrake"), "d"),
    **{"flaps_power": "I", "flap_motor_ok": "I", "num_engines": "I"},
    **{"master_bat": "4I", "master_alt": "4I", "magnetos": "4I", "starter_power": "4I4x"},
    **{
        "throttle": "4d",
        "mixture": "4d",
        "condition": "4d",
        "fuel_pump_power": "4I",
        "prop_advance": "4d",
    },
    **{
        "feed_tank_to": "4I",
        "reverse": "4I",
        "engine_ok": "4I",
        "mag_left_ok": "4I",
        "mag_right_ok": "4I",
        "spark_plugs_ok": "4I",
    },
    **{
        "oil_press_status": "4I",
        "fuel_pump_ok": "4I",
        "num_tanks": "I",
        "fuel_selector": "8I",
        "xfer_pump": "5I",
        "cross_feed": "I4x",
    },
    **dict.fromkeys(
        ("brake_left", "brake_right", "copilot_brake_left", "copilot_brake_right", "brake_parking"),
        "d",
    ),
    **{"gear_handle": "I", "master_avionics": "I"},
    **dict.fromkeys(
        ("comm_1", "comm_2", "nav_1", "nav_2", "wind_speed_kt", "wind_dir_deg", "turbulence_norm"),
        "d",
    ),
    **dict.fromkeys(("temp_c", "press_inhg", "hground", "magvar"), "d"),
    **{"icing": "I", "speedup": "I", "freeze": "I", "reserved": "25I"},
}


def length_of(layout: dict[str, str]) -> int:
    """Return the bytes of a message."""
    return struct.calcsize(">" + "".join(layout.values()))


def packed(layout: dict[str, str], values: dict[str, float | list]) -> bytes:
    """Return a message; what has no value is zero."""
    flat: list[float] = []
    for name, code in layout.items():
        count = len(struct.unpack(">" + code, bytes(struct.calcsize(">" + code))))
        value = values.get(name, 0)
        items = value if isinstance(value, list) else [value]
        flat += (items + [0] * count)[:count]
    return struct.pack(">" + "".join(layout.values()), *flat)


def unpacked(layout: dict[str, str], message: bytes) -> dict[str, float | tuple]:
    """Return the values of a message by name."""
    found, place = {}, 0
    for name, code in layout.items():
        values = struct.unpack_from(">" + code, message, place)
        found[name] = values[0] if len(values) == 1 else values
        place += struct.calcsize(">" + code)
    return found


# %% From the cockpit to the model, and back

AT_REST = {
    "throttle": None,
    "gear_handle": 0,
    "freeze": 0,
}  # until the first message; no lever: the trimmed one stays


def inputs_of(
    cockpit: dict, limits: dict[str, tuple[float, float]], lever: float
) -> dict[str, float]:
    """Return the model's inputs: surfaces from the trimmed ones, the lever from the trimmed
    `lever`.

    FlightGear: stick forward, stick right and right pedal are positive.  Here an elevator that
    pitches down is positive, aileron and rudder that roll and yaw to the left.
    """
    stick = {
        name: cockpit.get(name, 0.0) + cockpit.get(f"{name}_trim", 0.0)
        for name in ("elevator", "aileron", "rudder")
    }
    parking = cockpit.get("brake_parking", 0.0)
    up, down = limits["delta_e"]
    inputs = {
        "delta_e": stick["elevator"] * (down if stick["elevator"] > 0.0 else -up),
        "delta_a": -stick["aileron"] * limits["delta_a"][1],
        "delta_r": -stick["rudder"] * limits["delta_r"][1],
        "delta_f": cockpit.get("flaps", 0.0) * limits["delta_f"][1],
        "speedbrake": cockpit.get("speedbrake", 0.0),
        "gear": float(bool(cockpit.get("gear_handle", 0))),
    }
    for side in ("left", "right"):
        inputs[f"brake_{side}"] = min(
            1.0,
            max(
                cockpit.get(f"brake_{side}", 0.0),
                cockpit.get(f"copilot_brake_{side}", 0.0),
                parking,
            ),
        )
    levers = cockpit["throttle"]
    return inputs | {
        f"engine{i + 1}.throttle": 0.0 if levers is None else levers[i] - lever for i in range(2)
    }


def message_of(y: dict[str, float], limits: dict[str, tuple[float, float]]) -> bytes:
    """Return the message to FlightGear from the model's outputs."""
    sin_phi, cos_phi, turn = (
        np.sin(y["phi"]),
        np.cos(y["phi"]),
        y["q"] * np.sin(y["phi"]) + y["r"] * np.cos(y["phi"]),
    )
    engines, legs = ("engine1", "engine2"), ("nose", "left", "right")
    return packed(
        AEROPLANE,
        {
            "version": 24,
            "longitude": y["lon"],
            "latitude": y["lat"],
            "altitude": y["h"],
            "agl": y["h_agl"],
            **{name: y[name] for name in ("phi", "theta", "psi", "alpha", "beta")},
            "phidot": y["p"] + np.tan(y["theta"]) * turn,
            "thetadot": y["q"] * cos_phi - y["r"] * sin_phi,
            "psidot": turn / np.cos(y["theta"]),
            "vcas": y["V_cas"] / KT,
            "climb_rate": y["hdot"] / FT,
            "v_north": y["vn"] / FT,
            "v_east": y["ve"] / FT,
            "v_down": y["vd"] / FT,
            **{f"v_body_{name}": y[name] / FT for name in "uvw"},
            **{f"A_{axis.upper()}_pilot": y[f"a{axis}"] / FT for axis in "xyz"},
            "num_engines": 2,
            "eng_state": [2 if y[f"{name}.burning"] > 0.5 else 0 for name in engines],
            "rpm": [y[f"{name}.n1"] for name in engines],
            "fuel_flow": [y[f"{name}.fuel_flow"] * 3600.0 / GALLON for name in engines],
            "egt": [y[f"{name}.itt"] * 1.8 - 459.67 for name in engines],
            "num_tanks": 1,
            "fuel_quantity": [y["fuel"] / GALLON],
            "num_wheels": 3,
            "wow": [int(y[f"wow_{leg}"] > 0.5) for leg in legs],
            "gear_pos": [y["gear"]] * 3,
            "gear_compression": [y[f"gear.{leg}.compression"] / FT for leg in legs],
            "cur_time": int(time.time()),
            "visibility": 20e3,
            "elevator": y["applied.delta_e"] / limits["delta_e"][1],
            "left_aileron": y["applied.delta_a"] / limits["delta_a"][1],
            "right_aileron": -y["applied.delta_a"] / limits["delta_a"][1],
            "rudder": -y["applied.delta_r"] / limits["delta_r"][1],
            "left_flap": y["applied.delta_f"] / limits["delta_f"][1],
            "right_flap": y["applied.delta_f"] / limits["delta_f"][1],
            "speedbrake": y["speedbrake"],
        },
    )


# %% The loop


def newest(controls: socket.socket) -> dict | None:
    """Return the newest of the messages that wait, or None; a message of another length or version
    is an error.
    """
    message = None
    while True:
        try:
            message = controls.recv(4096)
        except BlockingIOError:
            break
    if message is None:
        return None
    if len(message) != length_of(CONTROLS) or message[:4] != struct.pack(">I", 27):
        raise SystemExit(
            f"a message of {len(message)} bytes, version "
            f"{int.from_bytes(message[:4], 'big')} came; allowed are the native controls of "
            f"FlightGear, {length_of(CONTROLS)} bytes, version 27: start it with "
            f"--native-ctrls=socket,out,60,HOST,PORT,udp"
        )
    return unpacked(CONTROLS, message)


def ticks(period: float) -> Iterator[None]:
    """Return at every full period of the clock on the wall; what is later than `LATE` is left
    out.
    """
    due = time.monotonic()
    while True:
        yield
        due += period
        ahead = due - time.monotonic()
        if ahead > 0.0:
            time.sleep(ahead)
        elif ahead < -LATE:
            due -= ahead


def started(sim: flightmech.SimModel, start: dict[str, float]) -> Simulation:
    """Return the aeroplane in trimmed level flight, gear and flaps up."""
    run = Simulation(sim.model)
    for name, value in {"mode.trim": 2.0, **start}.items():
        run.set_parameter(index_of_parameter(sim, name), value)
    run.set_inputs(np.zeros(len(sim.inputs)))
    run.initialize()
    return run


def fly(
    sim: flightmech.SimModel,
    limits: dict[str, tuple[float, float]],
    start: dict[str, float],
    controls: socket.socket,
    view: tuple[str, int],
    steps: int | None = None,
) -> None:
    """Fly until the pilot stops it, or for a number of `steps`.

    Parameters
    ----------
    sim : SimModel
        The aeroplane, two engines and three legs named nose, left and right.
    limits : dict of str to (float, float)
        Of the surfaces [rad].
    start : dict of str to float
        Parameters: place, height, speed.
    controls : socket
        What FlightGear's controls arrive at; bound, not blocking.
    view : (str, int)
        Host and port that the aeroplane is sent to.
    """
    run, names = started(sim, start), sim.outputs
    lever = run.outputs()[names.index("trim.throttle")]
    cockpit: dict = dict(AT_REST)
    before, flown = np.zeros(len(sim.inputs)), 0
    for _ in itertools.islice(ticks(1.0 / RATE), steps):
        cockpit = newest(controls) or cockpit
        u = dict.fromkeys(sim.inputs, 0.0) | inputs_of(cockpit, limits, lever)
        after = np.array([u[row.name] for row in sim.entries(INPUT)])
        if not int(cockpit["freeze"]) & 1:
            run.step(flown / RATE, 1.0 / RATE, before, after)
            before, flown = after, flown + 1
        y = dict(zip(names, run.outputs().tolist(), strict=True)) | {
            name: u[name] for name in ("gear", "speedbrake")
        }
        controls.sendto(message_of(y, limits), view)


def main() -> None:
    """Read the options, open the sockets, fly."""
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    options.add_argument(
        "--database", help="database file; the a-priori one of the DATCOM listings unless given"
    )
    options.add_argument("--host", default="127.0.0.1", help="machine of FlightGear (%(default)s)")
    options.add_argument(
        "--port", type=int, default=5500, help="its --native-fdm port (%(default)s)"
    )
    options.add_argument(
        "--controls", type=int, default=5501, help="port that --native-ctrls sends to (%(default)s)"
    )
    for name, value, text in (
        ("lat", 37.6, "latitude [deg]"),
        ("lon", -122.3, "longitude [deg]"),
        ("height", 1500.0, "above mean sea level [m]"),
        ("speed", 200.0, "true airspeed [kt]"),
        ("heading", 298.0, "[deg]"),
        ("runway", 4.0, "elevation of the ground [m]"),
    ):
        options.add_argument(f"--{name}", type=float, default=value, help=f"{text} (%(default)s)")
    given = options.parse_args()
    aircraft = flightmech.read_aircraft(DATA / "aircraft.toml")
    db = (
        aerodb.open(given.database)
        if given.database
        else a_priori(read_project(DATA / "aeromatch.toml"), aircraft)
    )
    start = {
        "init.lat": given.lat * DEG,
        "init.lon": given.lon * DEG,
        "init.psi": given.heading * DEG,
    }
    start |= {
        "init.h": given.height,
        "init.V": given.speed * KT,
        "env.runway_elevation": given.runway,
    }
    sim = flightmech.compile(aircraft, db)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as controls:
        controls.bind(("", given.controls))
        controls.setblocking(False)
        print(
            f"flying; controls from port {given.controls}, aeroplane to "
            f"{given.host}:{given.port}; Ctrl-C ends it"
        )
        try:
            fly(sim, aircraft.limits, start, controls, (given.host, given.port))
        except KeyboardInterrupt:
            print("ended")


if __name__ == "__main__":
    main()
