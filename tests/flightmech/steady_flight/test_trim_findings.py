"""A trim beyond a table or at the greatest lift is stated, and so is a control limit beyond a
table.
"""

import json

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

import flightmech
from flightmech.aircraft.engine import Engine
from flightmech.cli.group import fmu
from flightmech.errors import AeromatchWarning, SimulationError
from flightmech.steady_flight.trim_findings import (
    describe_inputs_beyond_limits,
    describe_limits_beyond_tables,
)
from flightmech.terms import make_term

DEG = np.pi / 180.0
START = {"init.h": 1000.0, "init.V": 60.0}


def make_aircraft(low=-28.0, high=20.0):
    """Return an aircraft with these limits of the elevator. [deg]"""
    return flightmech.Aircraft(
        "Small", 16.0, 1.5, 11.0, 1000.0, 1500.0, 2000.0, 3000.0,
        engines=(Engine((0.0, 0.0, 0.0)),),
        limits={"delta_e": (low * DEG, high * DEG)},
    )  # fmt: skip


def make_database(Cm_0=0.0):
    """Return a database with tables over alpha, -8 to 16 deg, and delta_e, -25 to 20 deg."""
    alpha = np.array([-8.0, 0.0, 12.0, 16.0]) * DEG
    elevator = np.array([-25.0, 0.0, 20.0]) * DEG
    leaves = {
        "/CL/basic": make_term([-0.5, 0.2, 1.3, 1.2], {"alpha": alpha}),
        "/CD/basic": make_term([0.06, 0.03, 0.1, 0.2], {"alpha": alpha}),
        "/Cm/basic": make_term([Cm_0 + 0.1, Cm_0, Cm_0 - 0.2, Cm_0 - 0.3], {"alpha": alpha}),
        "/Cm/delta_e": make_term([0.5, 0.0, -0.4], {"delta_e": elevator}),
        "/Cm/qhat": make_term(-12.0, regressors=["qhat"]),
        "/CY/beta": make_term(-0.5, regressors=["beta"]),
        "/Cl/beta": make_term(-0.08, regressors=["beta"]),
        "/Cl/phat": make_term(-0.4, regressors=["phat"]),
        "/Cl/delta_a": make_term(-0.1, regressors=["delta_a"]),
        "/Cn/beta": make_term(0.08, regressors=["beta"]),
        "/Cn/rhat": make_term(-0.1, regressors=["rhat"]),
        "/Cn/delta_r": make_term(-0.06, regressors=["delta_r"]),
    }
    return xr.DataTree.from_dict(leaves)


def trim_level(Cm_0=0.0, V=60.0, **limits):
    """Return level flight by thrust, with a pitching moment of its own."""
    sim = flightmech.compile(make_aircraft(**limits), make_database(Cm_0))
    return flightmech.trim(sim, {**START, "init.V": V, "mode.engine": 2}, "level")


def test_a_flight_within_the_tables_states_nothing():
    found = trim_level()
    assert found.attrs["verdict"] == "trimmed"
    assert found.attrs["tables_left"] == ""


def test_an_elevator_beyond_its_table_is_named():
    """Cm needs 0.55 nose up, the table ends at 0.5: the search stops where nothing acts any
    more.
    """
    found = trim_level(Cm_0=-0.5)
    assert not found.attrs["converged"]
    text = found.attrs["tables_left"]
    assert text.startswith("delta_e -2")
    assert text.endswith(" deg is beyond its table, which ends at -25 deg")
    assert text in found.attrs["verdict"]
    assert found.attrs["advice"].startswith("delta_e: held at the end of its table")
    assert "delta_e: nothing in database" not in found.attrs["advice"]


def test_the_trim_at_the_start_of_a_run_names_the_table_too():
    sim = flightmech.compile(make_aircraft(), make_database(Cm_0=-0.5))
    found = flightmech.trim(sim, {**START, "mode.engine": 2.0})
    assert found.attrs["tables_left"].endswith("is beyond its table, which ends at -25 deg")
    inside = flightmech.compile(make_aircraft(), make_database())
    assert flightmech.trim(inside, {**START, "mode.engine": 2.0}).attrs["tables_left"] == ""


def test_limits_inside_the_table_keep_the_trim_inside():
    found = trim_level(Cm_0=-0.5, low=-25.0)
    assert found.attrs["tables_left"] == ""
    assert "delta_e at its lower limit" in found.attrs["verdict"]


def test_a_fixed_input_beyond_its_limit_is_named():
    """The model flies with a gear of 3, which the aircraft does not reach."""
    sim = flightmech.compile(make_aircraft(), make_database())
    start = {**START, "init.V": 60.0, "mode.engine": 2}
    found = flightmech.trim(sim, start, "level", fixed={"gear": 3.0})
    assert "gear 3 is beyond its limit of 1" in found.attrs["verdict"]
    down = flightmech.trim(sim, start, "level", fixed={"gear": 1.0})
    assert down.attrs["verdict"] == "trimmed"
    assert describe_inputs_beyond_limits(sim, {"delta_e": np.radians(-40.0)}) == [
        "delta_e -40 deg is beyond its limit of -28 deg"
    ]


def test_a_trim_at_the_greatest_lift_states_it():
    """At 25 m/s level flight needs CL 1.77, the table has 1.3 at 12 deg."""
    with pytest.warns(AeromatchWarning, match="below the stall: the greatest lift of the tables"):
        slow = trim_level(V=25.0)
    assert not slow.attrs["converged"]
    assert "is at its maximum, near alpha 12 deg" in slow.attrs["verdict"]
    assert "maximum" not in trim_level(Cm_0=-0.5).attrs["verdict"]


def test_characteristics_name_table_and_lift():
    condition = {"V": 25.0, "h": 0.0, "mode.engine": 2.0}
    with pytest.raises(SimulationError, match=r"CL 1\.\d+ is at its maximum, near alpha 12 deg"):
        flightmech.characteristics(make_aircraft(), make_database(), condition)
    with pytest.raises(SimulationError, match=r"delta_e -2.* its table, which ends at -25 deg"):
        flightmech.characteristics(make_aircraft(), make_database(-0.5), {**condition, "V": 60.0})


def test_characteristics_of_a_steady_flight_beyond_a_table_state_it():
    """The flight is steady at Mach 0.18, beyond a drag table that ends at 0.1."""
    database = make_database()
    database["CD/mach"] = xr.DataTree(
        make_term([0.0, 0.001], {"mach": np.array([0.0, 0.1])}), name="mach"
    )
    condition = {"V": 60.0, "h": 0.0, "mode.engine": 2.0}
    with pytest.warns(AeromatchWarning, match=r"is Mach 0\.176, and the tables end at Mach 0\.1"):
        found = flightmech.characteristics(make_aircraft(), database, condition)
    assert found.tables_left == ("mach 0.1763 is beyond its table, which ends at 0.1",)
    assert found.tables_left[0] in found.report()
    plain = flightmech.characteristics(make_aircraft(), make_database(), condition)
    assert plain.tables_left == ()


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ((-25.0, 20.0), []),
        # 0.3 deg of 45 deg
        ((-25.3, 20.3), []),
        ((-28.0, 20.0), ["limit of delta_e -28 deg is beyond its table, which ends at -25 deg"]),
        ((-25.0, 23.0), ["limit of delta_e 23 deg is beyond its table, which ends at 20 deg"]),
    ],
)
def test_limits_beyond_a_table(limits, expected):
    sim = flightmech.compile(make_aircraft(*limits), make_database())
    assert describe_limits_beyond_tables(sim) == expected


def test_a_control_without_limits_is_not_named():
    free = flightmech.Aircraft("Small", 16.0, 1.5, 11.0, 1000.0, 1500.0, 2000.0, 3000.0)
    assert describe_limits_beyond_tables(flightmech.compile(free, make_database())) == []


@pytest.mark.nightly
def test_fmu_write_states_the_limits(tmp_path):
    flightmech.write_aircraft(make_aircraft(), tmp_path / "a.toml")
    sizes = {"S": 16.0, "cbar": 1.5, "b": 11.0, "x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0}
    database = make_database()
    database.attrs = {"title": "small", "aircraft": "Small", "force_axes": "stability", **sizes}
    database.to_netcdf(tmp_path / "d.nc", engine="h5netcdf")
    files = [str(tmp_path / "a.toml"), str(tmp_path / "d.nc"), "-o", str(tmp_path / "x.fmu")]
    text = CliRunner().invoke(fmu, ["write", *files]).output
    assert (
        "limit of delta_e -28 deg is beyond its table, which ends at -25 deg; the effect of the "
        "control stays as it is there\n" in text
    )
    document = json.loads(CliRunner().invoke(fmu, ["write", *files, "--json"]).output)
    assert document["limits_beyond_tables"] == [
        "limit of delta_e -28 deg is beyond its table, which ends at -25 deg"
    ]
