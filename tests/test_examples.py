"""The examples run from start to end and fly as announced."""

from __future__ import annotations

import importlib.util
import socket
import struct
from pathlib import Path

import numpy as np
import pytest

import flightmech
from aeromatch.project.project import read_project
from aeromatch.workflow.aerodynamics import a_priori
from flightmech.errors import AeromatchWarning

EXAMPLES = Path(__file__).parents[1] / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    return example


@pytest.mark.nightly
def test_fly_the_t37(tmp_path, capsys):
    example = load("fly_the_t37")
    with pytest.warns(AeromatchWarning, match="one condition per program run"):
        flights = example.main(tmp_path, None)
    assert {file.name for file in tmp_path.iterdir()} == {
        "doublet.png",
        "takeoff.png",
        "landing.png",
    }
    stated = capsys.readouterr().out
    assert stated.startswith("level at 180 kt: alpha ")
    assert "phugoid" in stated
    doublet, takeoff, landing = (flights[name] for name in ("doublet", "takeoff", "landing"))
    assert float(doublet["nz"].min()) < 0.8 < 1.1 < float(doublet["nz"].max())
    standing = takeoff["time"] < 8.0
    assert (
        float(abs(takeoff["V"].where(standing)).max()) < 0.1
    )  # the brakes hold full power; the nose dips
    airborne = int(np.argmax(takeoff["h_agl"].values > 2.0))
    assert 70.0 < float(takeoff["V_cas"][airborne]) / example.KT < 115.0
    touch = int(np.argmax(landing["wow_left"].values > 0.5))
    assert 0.2 < float(landing["vd"][touch - 1]) < 3.0
    assert float(landing["V"][-1]) < 1.0


@pytest.mark.slow
def test_read_a_listing(tmp_path, capsys):
    listing = load("read_a_listing").main(tmp_path)
    assert (tmp_path / "listing.png").is_file()
    assert len(listing) == 1
    assert "LIGHT HIGH-WING AIRCRAFT" in capsys.readouterr().out


@pytest.mark.nightly
def test_trim_over_speed():
    example = load("trim_over_speed")
    table = example.main()
    # slower flight needs more angle of attack and more elevator up
    assert (np.diff(table["alpha [deg]"]) < 0.0).all()
    assert (np.diff(table["delta_e [deg]"]) > 0.0).all()


@pytest.mark.nightly
def test_check_a_record():
    quality, marks = load("check_a_record").main()
    assert quality.usable
    assert {"3211", "doublet"} <= set(marks["manoeuvre"])


@pytest.mark.nightly
def test_identify_pitch():
    slopes = load("identify_pitch").main().to_dataframe()["estimate"]
    assert (slopes[["alpha", "qhat", "delta_e"]] < 0.0).all()


def cockpit(**values):
    """Return FlightGear's message of controls; places of the doubles as the C compiler sets them in
    net_ctrls.hxx, version 27.
    """
    places = {"aileron": 8, "elevator": 16, "rudder": 24, "throttle": 160, "brake_left": 496}
    message = bytearray(744)
    struct.pack_into(">I", message, 0, 27)
    for name, value in values.items():
        if name == "throttle":
            struct.pack_into(">4d", message, places[name], *[value] * 4)
        else:
            struct.pack_into(">d", message, places[name], value)
    return bytes(message)


def aeroplane(message):
    """Return what FlightGear reads from a message of the model, by the places of net_fdm.hxx,
    version 24.
    """
    assert len(message) == 408
    assert message[:4] == struct.pack(">I", 24)
    names = {
        "agl": 32,
        "phi": 36,
        "theta": 40,
        "psi": 44,
        "vcas": 68,
        "climb_rate": 72,
        "rudder": 392,
    }
    found = dict(
        zip(
            ("longitude", "latitude", "altitude"),
            struct.unpack_from(">3d", message, 8),
            strict=True,
        )
    )
    return found | {
        name: struct.unpack_from(">f", message, place)[0] for name, place in names.items()
    }


@pytest.fixture(scope="module")
def t37_in_flightgear():
    """Return the example, the compiled T-37, its limits and where it starts."""
    example = load("fly_in_flightgear")
    aircraft = flightmech.read_aircraft(example.DATA / "aircraft.toml")
    with pytest.warns(AeromatchWarning, match="one condition per program run"):
        sim = flightmech.compile(
            aircraft, a_priori(read_project(example.DATA / "aeromatch.toml"), aircraft)
        )
    start = {
        "init.lat": 0.65,
        "init.lon": -2.13,
        "init.psi": 5.2,
        "init.h": 1500.0,
        "init.V": 100.0,
        "env.runway_elevation": 4.0,
    }
    return example, sim, aircraft.limits, start


@pytest.mark.slow
@pytest.mark.parametrize(
    ("held", "moves"),
    [
        ({}, None),
        ({"elevator": -0.2}, ("theta", 1)),
        ({"aileron": 0.2}, ("phi", 1)),
        ({"rudder": 0.5}, ("rudder", 1)),  # the surface alone: Digital DATCOM knows no rudder
        ({"throttle": 0.0}, ("vcas", -1)),
    ],
    ids=["nothing", "stick back", "stick right", "right pedal", "idle"],
)
def test_fly_in_flightgear(held, moves, t37_in_flightgear):
    """A second and a half against a socket that stands for FlightGear; the motion follows the
    control and has its sign.
    """
    example, sim, limits, start = t37_in_flightgear
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as flightgear,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as controls,
    ):
        flightgear.bind(("127.0.0.1", 0))
        flightgear.setblocking(False)
        controls.bind(("127.0.0.1", 0))
        controls.setblocking(False)
        if held:
            lever = {
                "throttle": example.started(sim, start).outputs()[
                    sim.outputs.index("trim.throttle")
                ]
            }
            flightgear.sendto(cockpit(**(lever | held)), controls.getsockname())
        example.fly(sim, limits, start, controls, flightgear.getsockname(), steps=90)
        seen = []
        while len(seen) < 90:
            seen.append(aeroplane(flightgear.recv(1024)))
    first, last = seen[0], seen[-1]
    assert first["latitude"] == pytest.approx(0.65, abs=1e-6)  # within 6 m
    assert first["longitude"] == pytest.approx(-2.13, abs=1e-6)
    assert first["altitude"] == pytest.approx(1500.0, abs=1.0)
    assert first["agl"] == pytest.approx(1496.0, abs=1.0)
    assert first["vcas"] == pytest.approx(
        100.0 / example.KT * 0.93, rel=0.01
    )  # 1500 m: calibrated 7 % below true
    way = (
        np.hypot(
            last["latitude"] - first["latitude"],
            (last["longitude"] - first["longitude"]) * np.cos(0.65),
        )
        * 6.37e6
    )
    assert way == pytest.approx(100.0 * 89 / 60.0, rel=0.02)
    change = {name: last[name] - first[name] for name in ("phi", "theta", "psi", "vcas")} | {
        "rudder": last["rudder"]
    }
    if moves is None:
        assert max(abs(change[name]) for name in ("phi", "theta", "psi")) < 1e-3
    else:
        name, sign = moves
        assert sign * change[name] > (0.5 if name == "vcas" else 0.02)


@pytest.mark.slow
def test_other_messages_than_flightgears_controls_are_refused(t37_in_flightgear):
    example, *_ = t37_in_flightgear
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as controls:
        controls.bind(("127.0.0.1", 0))
        controls.setblocking(False)
        assert example.newest(controls) is None
        controls.sendto(b"\0" * 400, controls.getsockname())
        with pytest.raises(
            SystemExit,
            match="a message of 400 bytes, version 0 came; allowed are the native controls of "
            "FlightGear, 744 bytes",
        ):
            example.newest(controls)
