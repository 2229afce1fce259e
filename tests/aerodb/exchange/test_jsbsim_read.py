"""The aerodynamics subset of JSBSim files: round trips, and the aircraft that come with JSBSim."""

import importlib.util
import re
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import aerodb
import flightmech
from flightmech.errors import AeromatchWarning, ParseError, SchemaError, UnknownName
from flightmech.units import DEGREE, FOOT

HERE = Path(__file__).parent


def loaded(name):
    spec = importlib.util.spec_from_file_location(name, HERE / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


flight, writing = loaded("jsbsim_flight"), loaded("test_jsbsim_write")
ROUNDING = 1e-12  # as in test_jsbsim_write


@pytest.mark.nightly
@pytest.mark.parametrize("force_axes", ["stability", "wind", "body"])
@pytest.mark.parametrize("jsbsim_min", ["1.3.1", "1.2"])
def test_round_trip(force_axes, jsbsim_min, tmp_path):
    """Term by term; heights, speeds and pressures go through feet: one rounding, 1e-15."""
    db = writing.synthetic(force_axes)
    aerodb.exchange.export_jsbsim(db, tmp_path / "test.xml", writing.craft(), jsbsim_min=jsbsim_min)
    back = aerodb.exchange.import_jsbsim(tmp_path / "test.xml")
    ours, theirs = aerodb.terms(db), aerodb.terms(back)
    assert set(ours) == set(theirs)
    for name, leaf in ours.items():
        leaf, found = (
            leaf.squeeze(drop=True),
            theirs[name],
        )  # an axis of one breakpoint carries no information
        assert found.attrs["regressors"] == leaf.attrs["regressors"], name
        for table in ("value", "K1", "K2"):
            assert (table in found) == (table in leaf), name
            if table in leaf:
                assert found[table].dims == leaf[table].dims, name
                np.testing.assert_allclose(found[table], leaf[table], rtol=1e-15, err_msg=name)
                for axis in leaf[table].dims:
                    np.testing.assert_allclose(found[axis], leaf[axis], rtol=1e-15, err_msg=name)
    assert back.attrs["force_axes"] == force_axes
    for key in ("S", "cbar", "b", "x_ref", "y_ref", "z_ref"):
        assert back.attrs[key] == pytest.approx(db.attrs[key], rel=1e-15)
    assert back.attrs["title"] == "synthetic"
    assert back.attrs["comment"] == ""


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["T37", "A320", "c310", "f15", "pa28"])
def test_shipped_aircraft_fly_equal(name):
    """Whole aircraft of the package, JSBSim's forces and moments at random states; flaps out are
    taken as 40 deg.
    """
    jsbsim = pytest.importorskip("jsbsim", reason="jsbsim is not installed: pip install jsbsim")
    path = Path(jsbsim.get_default_root_dir()) / "aircraft" / name / f"{name}.xml"
    db = aerodb.exchange.import_jsbsim(path, travel={"delta_f": 40 * DEGREE})
    given, commands = flight.states(200, seed=2)
    found, F, M = flight.fly(path, given, commands, ("fcs/flap-pos-norm",), shipped=True)
    craft = SimpleNamespace(**{key: db.attrs[key] for key in ("S", "cbar", "b")}, x_ref_mac=0.25)
    at = flight.conditions(found, craft) | {"delta_a": -found["left"]}
    if name in ("T37", "A320"):  # their files move the fraction, and the angle not with it
        at["delta_f"] = found["fcs/flap-pos-norm"] * 40 * DEGREE
    force, moment = flight.loads(db, at, craft)
    assert flight.worst(force, F).max() < ROUNDING
    assert flight.worst(moment, M).max() < ROUNDING


@pytest.mark.nightly
def test_induced_drag_flies_equal():
    """The A-4's CDi = k CL^2: with the lift of JSBSim's step before, and at rest, when that is the
    lift of the same instant.
    """
    jsbsim = pytest.importorskip("jsbsim", reason="jsbsim is not installed: pip install jsbsim")
    path = Path(jsbsim.get_default_root_dir()) / "aircraft" / "A4" / "A4.xml"
    db = aerodb.exchange.import_jsbsim(path)
    craft = SimpleNamespace(**{key: db.attrs[key] for key in ("S", "cbar", "b")}, x_ref_mac=0.25)
    given, commands = flight.states(8, seed=2)
    for settle, exact in ((0, False), (2000, True)):
        found, F, M = flight.fly(
            path, given, commands, ("aero/cl-squared",), shipped=True, settle=settle
        )
        at = flight.conditions(found, craft) | {"delta_a": -found["left"]}
        force, moment = flight.loads(db, at | {"CL": np.sqrt(found["aero/cl-squared"])}, craft)
        assert flight.worst(force, F).max() < ROUNDING
        assert flight.worst(moment, M).max() < ROUNDING
        assert (flight.worst(flight.loads(db, at, craft)[0], F).max() < ROUNDING) == exact


@pytest.mark.nightly
def test_the_list_of_aircraft_that_are_read():
    """Every name of docs/evidence/jsbsim-aircraft.md."""
    jsbsim = pytest.importorskip("jsbsim", reason="jsbsim is not installed: pip install jsbsim")
    page = (HERE.parents[2] / "docs" / "evidence" / "jsbsim-aircraft.md").read_text()
    read = set(re.findall(r"`([^`]+)`", page[page.index("\nRead: ") : page.index("\nLargest")]))
    refused = set(re.findall(r"^\| (\S+) \| .*refused", page, re.M))
    folder = Path(jsbsim.get_default_root_dir()) / "aircraft"
    assert sorted([*read, *refused]) == sorted(
        path.name for path in folder.iterdir() if path.is_dir()
    )
    for name in read | refused:
        path = folder / name / f"{name}.xml"
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", AeromatchWarning)
                db = aerodb.exchange.import_jsbsim(path)
            flightmech.compile(aerodb.exchange.import_jsbsim_aircraft(path), db)
        except (ParseError, SchemaError):
            assert name in refused
        else:
            assert name in read
    assert len(read) >= 45


@pytest.mark.nightly
def test_t37_by_name(tmp_path):
    """Numbers as they stand in T37.xml, 41 functions on its axes."""
    jsbsim = pytest.importorskip("jsbsim", reason="jsbsim is not installed: pip install jsbsim")
    path = Path(jsbsim.get_default_root_dir()) / "aircraft" / "T37" / "T37.xml"
    with pytest.warns(
        AeromatchWarning,
        match=r"fcs/flap-pos-norm is device\.fcs_flap_pos_norm\.setting; .* travel = \{'delta_f': "
        r"angle where it is 1\} makes the fraction delta_f",
    ):
        as_it_stands = aerodb.exchange.import_jsbsim(path)
    assert "device.fcs_flap_pos_norm.setting" in aerodb.terms(as_it_stands)["CL/dCLflap"].regressors
    db = aerodb.exchange.import_jsbsim(path, travel={"delta_f": 0.7})
    leaves = aerodb.terms(db)
    assert len(leaves) == 41
    assert db.attrs["force_axes"] == "wind"
    assert leaves["Cm/Cmq"].attrs["regressors"] == "qhat"
    assert float(leaves["Cm/Cmq"]["value"]) == pytest.approx(-50.0, rel=1e-15)
    assert float(leaves["Cl/Clr"]["value"]) == pytest.approx(0.0926, rel=1e-15)
    np.testing.assert_allclose(
        leaves["CL/CLalpha"]["value"], [-0.64, 0.08, 1.339, 0.448], rtol=1e-15
    )
    assert leaves["CL/CLalpha"]["K1"].dims == ("h_agl",)
    assert leaves["CL/CLalpha"]["h_agl"].values[-1] == pytest.approx(1.1 * 33.83 * FOOT, rel=1e-15)
    assert float(leaves["CL/dCLflap"]["value"].max()) * 0.7 == pytest.approx(
        0.35 * 1.061, rel=1e-14
    )
    assert leaves["Cn/DCnbDg"].attrs["regressors"] == "gear"
    assert leaves["CL/CLalpha"].attrs["references"].endswith("aero/coefficient/CLalpha")
    assert leaves["CL/CLalpha"].attrs["comment"] == "Lift_due_to_alpha"
    aerodb.save(db, tmp_path / "t37.nc")
    assert aerodb.open(tmp_path / "t37.nc").identical(db)


def test_what_is_no_term_is_named():
    """The J-3 has tables over its Reynolds number, which is not a model variable."""
    jsbsim = pytest.importorskip("jsbsim", reason="jsbsim is not installed: pip install jsbsim")
    path = Path(jsbsim.get_default_root_dir()) / "aircraft" / "J3Cub" / "J3Cub.xml"
    with pytest.raises(SchemaError, match="leave_out = ") as caught:
        aerodb.exchange.import_jsbsim(path)
    named = [problem.split(": ")[1] for problem in caught.value.problems]
    assert all("line " in problem for problem in caught.value.problems)
    with pytest.warns(AeromatchWarning, match="engine_thrust_coefficient"):
        db = aerodb.exchange.import_jsbsim(path, leave_out=named)
    assert len(db.attrs["absent"].split()) == len(named)
    with pytest.raises(UnknownName, match="unknown function 'aero/coefficient/nosuch'"):
        aerodb.exchange.import_jsbsim(path, leave_out=["aero/coefficient/nosuch"])
