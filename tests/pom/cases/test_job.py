"""What drives a case: engines by lever, speed or thrust, brakes, and a start on the wheels."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from flightmech.errors import SchemaError, UnknownName
from pom.cases.case import read_case
from pom.cases.job import job_of
from pom.cases.start_conditions import line_at_start, quiet_time


@pytest.fixture
def rolling() -> xr.Dataset:
    """Two seconds on a runway at 118 m, at 3 m/s, pitched up by 2 degrees, in 4 m/s of wind from
    ahead.
    """
    t = np.arange(0.0, 10.0, 0.1)
    still = {
        "phi": 0.0,
        "theta": np.radians(2.0),
        "psi": 1.5,
        "p": 1e-4,
        "q": -2e-4,
        "r": 1e-4,
        "V": 7.0,
        "alpha": 0.1,
        "beta": 0.0,
    }
    still |= {
        "h": 119.0,
        "vn": 3.0 * np.cos(1.5),
        "ve": 3.0 * np.sin(1.5),
        "delta_e": 0.01,
        "delta_a": 0.0,
        "delta_r": 0.0,
    }
    still |= {
        "u": 7.0,
        "v": 0.0,
        "w": 0.7,
        "x_cg_b": 0.1,
        "y_cg_b": 0.0,
        "z_cg_b": 0.2,
        "wow_left": 1.0,
    }
    still |= {"engine1.thrust": 900.0, "engine1.n1": 0.8, "engine1.throttle": 0.6}
    still |= {"engine1.torque": 1200.0, "engine1.rpm": 220.0, "engine1.manifold_pressure": 8e4}
    data = {name: ("time", np.full(t.size, value)) for name, value in still.items()}
    down = -np.sin(still["theta"]) * 0.1 + np.cos(still["theta"]) * 0.2
    return xr.Dataset(
        {
            **data,
            "h_agl": ("time", np.full(t.size, 1.0 + down)),
            "brake": ("time", np.where(t < 4.0, 0.7, 0.004)),
        },
        {"time": t},
    )


def job(write_case, tmp_path, states, drive: str):
    path = write_case()
    path.write_text(path.read_text().replace('engine = "thrust"', drive))
    return job_of(read_case(path), states)


@pytest.mark.parametrize(
    ("engine", "drive", "value", "mode"),
    [
        ("thrust", "thrust_drive", 900.0, 2.0),
        ("n1", "n1_drive", 0.8, 1.0),
        ("throttle", "throttle", 0.6, 0.0),
        ("lever", "throttle", 0.6, 0.0),
        ("torque", "torque_drive", 1200.0, 3.0),
        ("rpm", "rpm_drive", 220.0, 4.0),
        ("map", "manifold_pressure_drive", 8e4, 5.0),
    ],
)
def test_engines_are_driven_as_the_case_states(
    engine, drive, value, mode, write_case, tmp_path, rolling
):
    found = job(write_case, tmp_path, rolling, f'engine = "{engine}"')
    assert found.inputs["engine1." + drive] == pytest.approx(value, rel=1e-12)
    assert found.parameters["mode.engine"] == mode
    by_lever = engine in ("throttle", "lever")
    assert found.parameters["mode.trim"] == (2.0 if by_lever else 1.0)
    # with a recorded speed of the propeller the lever is the power
    assert ("engine1.throttle" in found.inputs) == (by_lever or engine == "rpm")


def test_levers_of_the_propeller_are_inputs(write_case, tmp_path, rolling):
    rolling = rolling.assign({"engine1.prop_command": ("time", 0.7 + 0.0 * rolling["time"].values)})
    found = job(write_case, tmp_path, rolling, 'engine = "map"')
    assert set(found.inputs["engine1.prop_command"]) == {0.7}
    assert "engine1.rpm_drive" not in found.inputs
    # the recorded speed in its place, and a mixture that the case holds
    drive = 'engine = "torque"\npropeller = "rpm"\n[conditions]\n"engine1.mixture" = 0.8'
    path = write_case()
    text = path.read_text().replace('engine = "thrust"', drive)
    path.write_text(text)
    found = job_of(read_case(path), rolling)
    assert set(found.inputs["engine1.rpm_drive"]) == {220.0}
    assert set(found.inputs["engine1.mixture"]) == {0.8}
    assert set(found.inputs["engine1.torque_drive"]) == {1200.0}
    without = rolling.drop_vars("engine1.rpm")
    with pytest.raises(UnknownName, match=r'drive\.propeller is "rpm"'):
        job_of(read_case(path), without)
    # a recorded thrust depends on no lever
    assert not {"engine1.prop_command", "engine1.mixture"} & set(
        job(write_case, tmp_path, rolling, 'engine = "thrust"').inputs
    )


def test_recorded_speed_belongs_to_torque_or_pressure(write_case, tmp_path, rolling):
    with pytest.raises(SchemaError, match=r"write drive\.engine"):
        job(write_case, tmp_path, rolling, 'engine = "n1"\npropeller = "rpm"')


def test_start_on_the_wheels(write_case, tmp_path, rolling):
    found = job(write_case, tmp_path, rolling, 'trim = "ground"')
    at = found.parameters
    assert (at["mode.trim"], at["init.p"], at["init.gamma"]) == (3.0, 0.0, 0.0)
    assert at["init.V"] == pytest.approx(3.0)  # over the ground, whatever the wind
    assert at["env.runway_elevation"] == pytest.approx(118.0, abs=1e-9)
    assert "init.u_dot" not in at
    standing = rolling.assign(vn=0.05 + 0.0 * rolling["vn"], ve=0.02 + 0.0 * rolling["ve"])
    assert job(write_case, tmp_path, standing, 'trim = "ground"').parameters["init.V"] == 0.0


def test_one_pedal_recorded_brakes_both_wheels_and_its_noise_none(write_case, tmp_path, rolling):
    found = job(write_case, tmp_path, rolling, "trim = true")
    for side in ("brake_left", "brake_right"):
        assert found.inputs[side] == pytest.approx(
            np.where(rolling["brake"] > 0.5, 0.7, 0.0), abs=1e-12
        )  # the first is a mean
        assert side in found.needed_inputs
    released = rolling.assign(brake=rolling["brake"] * 0.0 + 0.004)
    assert "brake_left" not in job(write_case, tmp_path, released, "trim = true").needed_inputs


TRAVELS = {"column": 0.03, "wheel": 0.2, "pedal": -0.01}
FORCES = {"F_column": 20.0, "F_wheel": 1.0, "F_pedal": -5.0}


def cockpit(states: xr.Dataset, values: dict[str, float]) -> xr.Dataset:
    return states.assign(
        {name: ("time", np.full(states.sizes["time"], value)) for name, value in values.items()}
    )


@pytest.mark.parametrize(
    ("level", "values", "mode"), [("cockpit", TRAVELS, 1.0), ("force", FORCES, 2.0)]
)
def test_cockpit_channels_drive_and_surfaces_give_the_start_only(
    level, values, mode, write_case, tmp_path, rolling
):
    moving = rolling.assign(delta_e=0.01 + 0.001 * (rolling["time"] > 2.0))
    found = job(
        write_case, tmp_path, cockpit(moving, values), f'engine = "thrust"\nsurfaces = "{level}"'
    )
    assert {name: found.inputs[name][-1] for name in values} == values
    assert set(values) <= set(found.needed_inputs)
    assert set(found.inputs["delta_e"]) == {0.01}  # held: the circuits start there, then move it
    assert "delta_e" not in found.needed_inputs
    assert found.parameters["mode.controls"] == mode


def test_surfaces_are_the_default_and_set_no_mode(write_case, tmp_path, rolling):
    assert "mode.controls" not in job(write_case, tmp_path, rolling, 'engine = "thrust"').parameters


def test_friction_holds_controls_that_forces_drive_and_no_others(write_case, tmp_path, rolling):
    states = cockpit(rolling, {"F_column": 20.0, "F_wheel": 0.0, "F_pedal": 0.0})
    found = job(
        write_case, tmp_path, states, 'engine = "thrust"\nsurfaces = "force"\nheld_by = "friction"'
    )
    assert (
        found.parameters["column.trim_friction"] == found.parameters["pedal.trim_friction"] == 1.0
    )
    with pytest.raises(
        SchemaError,
        match=r'"friction" holds controls that forces drive; drive.surfaces is "cockpit"',
    ):
        job(
            write_case,
            tmp_path,
            states,
            'engine = "thrust"\nsurfaces = "cockpit"\nheld_by = "friction"',
        )


def test_a_force_that_is_not_recorded_is_required_or_held(write_case, tmp_path, rolling):
    states = cockpit(rolling, {"F_column": 20.0})
    drive = 'engine = "thrust"\nsurfaces = "force"'
    with pytest.raises(
        UnknownName,
        match=r"'F_wheel'.*drives the pilot forces as recorded; map the channel, or hold it by "
        r"\[conditions\]",
    ):
        job(write_case, tmp_path, states, drive)
    held = job(write_case, tmp_path, states, drive + "\n[conditions]\nF_wheel = 0.0\nF_pedal = 0.0")
    assert not held.inputs["F_wheel"].any()


def test_wind_of_the_record_or_none(write_case, tmp_path, rolling):
    windy = rolling.assign(wind_n=0.0 * rolling["time"] + 4.0)
    assert set(job(write_case, tmp_path, windy, 'engine = "thrust"').inputs["wind_n"]) == {4.0}
    assert (
        "wind_n" not in job(write_case, tmp_path, windy, 'engine = "thrust"\nwind = "none"').inputs
    )


def test_a_loop_on_the_throttle_moves_every_lever(write_case, tmp_path, rolling):
    states = rolling.assign(
        {
            "engine2.throttle": rolling["engine1.throttle"],
            "engine2.thrust": rolling["engine1.thrust"],
        }
    )
    loop = (
        '[[drive.pilot]]\ncontrol = "throttle"\nchannel = "V_cas"\ngain = "2 %/kt"\nlimit = "30 %"'
    )
    drive = f'engine = "throttle"\nsurfaces = "pilot"\n{loop}'
    found = job(write_case, tmp_path, states.assign(V_cas=states["V"]), drive)
    assert [loop.control for loop in found.pilot] == ["engine1.throttle", "engine2.throttle"]
    assert set(found.targets["V_cas"]) == {7.0}
    with pytest.raises(UnknownName, match=r"'V_cas'.*the math pilot holds it"):
        job(write_case, tmp_path, states, drive)


def test_controls_that_only_the_tables_know_are_driven_as_recorded(write_case, tmp_path, rolling):
    states = rolling.assign(
        {"device.body_flap.deflection": ("time", np.linspace(0.0, 0.1, rolling.sizes["time"]))}
    )
    found = job(write_case, tmp_path, states, 'engine = "thrust"')
    assert found.inputs["device.body_flap.deflection"][-1] == 0.1
    assert (
        "device.body_flap.deflection" in found.needed_inputs
    )  # a model without it cannot fly the case


def test_a_case_holds_a_control_that_only_the_tables_know(write_case, tmp_path, rolling):
    held = '\n\n[conditions]\n"device.ice.setting" = 1.0\n'
    found = job(write_case, tmp_path, rolling, 'engine = "thrust"' + held)
    assert set(found.inputs["device.ice.setting"]) == {1.0}
    # a model without ice cannot fly the case
    assert "device.ice.setting" in found.needed_inputs


TANKS = """
name = "two_tanks"
S = 17.0
cbar = 1.67
b = 10.3
mass = 2300.0
Ixx = 10800.0
Iyy = 8100.0
Izz = 15100.0

[[engine]]
position = [-0.3, 0.0, 0.1]
feed = ["left", "right"]

[fuel]
mass = 300.0
tank = [
    { name = "left", position = [0.0, -2.0, 0.0], capacity = 200.0, content = 150.0 },
    { name = "right", position = [0.0, 2.0, 0.0], capacity = 200.0, content = 150.0 },
]
"""


@pytest.mark.filterwarnings("ignore:.*burns no fuel")
def test_recorded_contents_start_the_tanks_and_recorded_valves_move(write_case, tmp_path, rolling):
    """Mass and c.g. of the record hold with the contents; the inertia follows the aircraft file."""
    (tmp_path / "tanks.toml").write_text(TANKS)
    path = write_case(case='aircraft = "tanks.toml"')
    path.write_text(
        path.read_text().replace('engine = "thrust"', 'engine = "n1"\n[conditions]\ncrossfeed = 1')
    )
    t = rolling["time"].values
    recorded = {
        "tank.left.fuel": ("time", 100.0 - 0.1 * t),
        "tank.right.fuel": ("time", 201.0 + 0.0 * t),
        "tank.left.cutoff": ("time", np.where(t < 5.0, 0.0, 1.0)),
        "transfer.left.right.pump": ("time", np.where(t < 2.0, 0.0, 1.0)),
        "mass": ("time", 2250.0 + 0.0 * t),
    }
    found = job_of(read_case(path), rolling.assign(recorded))
    p = found.parameters
    assert (p["init.tank.left.fuel"], p["init.tank.right.fuel"]) == (100.0, 200.0)
    assert (p["mass.tank.left.fuel"], p["mass.mass"], p["mass.x_cg_b"]) == (100.0, 2250.0, 0.1)
    # 300 kg at 2 m before and after, about a c.g. that moved to the right
    shift = 2.0 * (200.0 - 100.0) / 2300.0
    assert p["mass.Ixx"] == pytest.approx(10800.0 - 2300.0 * shift**2, rel=1e-12)
    assert p["mass.Iyy"] == pytest.approx(8100.0, rel=1e-12)
    assert found.inputs["tank.left.cutoff"].sum() == 50
    assert found.inputs["transfer.left.right.pump"].sum() == 80
    assert set(found.inputs["crossfeed"]) == {1.0}
    assert {"crossfeed", "tank.left.cutoff", "transfer.left.right.pump"} <= set(found.needed_inputs)
    alone = job_of(read_case(path), rolling)
    assert not any("tank" in name for name in alone.parameters)
    assert "mass.Ixx" not in alone.parameters


@pytest.mark.parametrize(
    ("name", "size", "quiet"),
    [
        ("delta_e", np.radians(5.0), 0.5),
        ("F_column", 25.0, 0.5),
        ("engine1.throttle", 0.4, 0.5),
        ("engine1.thrust", -300.0, 0.5),
        # noise of a pick-up, turbulence of a thrust, and a wind are no input
        ("delta_e", np.radians(0.8), 0.8),
        ("engine1.thrust", -40.0, 0.8),
        ("wind_n", 5.0, 0.8),
    ],
)
def test_the_start_is_taken_before_a_control_moves(name, size, quiet):
    """A step at 0.5 s of 0.8 s moves the start of a line through all of it by -0.3 of its size."""
    time = np.arange(0.0, 4.0, 0.02)
    level = 1000.0 if name.endswith("thrust") else 0.1
    values = np.where(time > 0.5, level + size, level)
    q = np.where(time > 0.5, time - 0.5, 0.0)
    states = xr.Dataset({name: ("time", values), "q": ("time", q)}, {"time": time})
    assert quiet_time(states) == pytest.approx(quiet)
    assert line_at_start(time, values, quiet_time(states))[0] == pytest.approx(
        level if quiet < 0.8 else line_at_start(time, values)[0]
    )
    assert line_at_start(time, values)[0] == pytest.approx(
        level - 0.316 * size, abs=0.02 * abs(size)
    )
    assert (line_at_start(time, q, quiet_time(states))[1] == 0.0) == (quiet < 0.8)


def test_a_control_that_moves_from_the_start_on_leaves_the_shortest_part():
    time = np.arange(0.0, 4.0, 0.02)
    states = xr.Dataset({"delta_r": ("time", time)}, {"time": time})
    assert quiet_time(states) == pytest.approx(0.2)
    gap = states.assign(delta_r=("time", np.where(time < 1.0, np.nan, time)))
    assert quiet_time(gap) == pytest.approx(0.8)
