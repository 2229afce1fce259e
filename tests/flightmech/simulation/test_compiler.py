"""What the compiler refuses and what it writes."""

from __future__ import annotations

import math

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.errors import SchemaError
from flightmech.names import lookup
from flightmech.simulation.kernel import (
    FIXED,
    INPUT,
    INTEGER,
    OUTPUT,
    PARAMETER,
    TERM,
    VARIABLE,
    computable_names,
)
from flightmech.terms import make_term
from flightmech.units import parse_unit


def aircraft(**changes) -> flightmech.Aircraft:
    return flightmech.Aircraft("glider", 15.0, 1.2, 14.0, 500.0, 1500.0, 900.0, 2300.0, **changes)


def tree(attrs=None, **leaves: xr.Dataset) -> xr.DataTree:
    found = xr.DataTree.from_dict(
        {f"/{name.replace('__', '/')}": leaf for name, leaf in leaves.items()}
    )
    found.attrs.update(attrs or {})
    return found


def refused(db: xr.DataTree, **changes) -> list[str]:
    with pytest.raises(SchemaError) as caught:
        flightmech.compile(aircraft(**changes), db)
    return caught.value.problems


def test_all_problems_at_once():
    broken = make_term(1.0)
    broken.attrs["regressors"] = "fuel_flow"
    problems = refused(
        tree(
            {"force_axes": "stability", "S": 16.0},
            CL__a=make_term([1.0, 2.0], {"V_cas": [50.0, 60.0]}),
            CL__b=broken,
            CX__c=make_term(0.1),
            Cm__d=make_term([1.0, 2.0], {"alphadothat": [0.0, 1.0]}),
            Cn__e=make_term(1.0, regressors=["dnz", "betadothat"]),
            Cl__f=make_term(1.0, regressors=["throttle"]),
        )
    )
    text = "\n".join(problems)
    for part in (
        "S is 16 in the database and 15 in the aircraft",
        "/CX is not a coefficient; with force_axes stability there are CL, CD, CY, Cl, Cm, Cn",
        "CL/a: axis: unknown model variable of the simulation 'V_cas'",
        "CL/b: regressor: unknown model variable of the simulation 'fuel_flow'",
        "Cm/d: alphadothat cannot be an axis, the simulation solves for it; make it a regressor",
        "Cn/e: regressors dnz betadothat: only one of alphadothat, betadothat, dnz",
        "Cl/f: regressor: unknown model variable of the simulation 'throttle'",
        "write engine1.throttle",
    ):
        assert part in text, text


def test_a_broken_leaf_is_named():
    leaf = make_term([1.0, 2.0], {"alpha": [0.0, 1.0]})
    leaf["value"].values[0] = np.nan
    assert refused(tree(CL__basic=leaf)) == [
        "CL/basic: value holds 1 NaN or infinite nodes of 2; trim or fill the table first"
    ]


def test_a_table_that_would_not_fly_is_an_error():
    problems = refused(
        tree(
            CL=make_term(0.2),
            CD__flap__slotted=make_term(0.1),
            CD__flap=make_term(0.1),
            checks__flown__once=make_term(0.0),
        )
    )
    assert problems == [
        f"{path} holds a table; a term lies at /<coefficient>/<contribution>, this one would "
        f"not fly"
        for path in ("/CL", "/CD/flap/slotted")
    ]


def test_force_axes():
    assert "attribute force_axes is 'earth'; allowed: stability, wind, body" in refused(
        tree({"force_axes": "earth"}, CL__a=make_term(1.0))
    )
    sim = flightmech.compile(
        aircraft(), tree({"force_axes": "body"}, CX__a=make_term(-0.02), CZ__a=make_term(-0.5))
    )
    assert sim.terms == ("CX/a", "CZ/a")
    assert sim.meta["force_axes"] == "body"


def test_moment_reference_must_agree():
    problems = refused(tree({"x_ref": -3.0}, CL__a=make_term(1.0)), reference=(-2.5, 0.0, 0.0))
    assert problems == [
        "x_ref is -3 m in the database and -2.5 m in the aircraft; move the moment reference"
    ]


def test_names_follow_the_vocabulary_and_units_parse():
    engine = flightmech.aircraft.Engine(
        (0.0, 0.0, 0.0), thrust=make_term([0.0, 900.0], {"throttle": [0.0, 1.0]})
    )
    sim = flightmech.compile(
        aircraft(engines=(engine,)),
        tree(CL__basic=make_term(0.4), Cm__qhat=make_term(-9.0, regressors=["qhat"])),
    )
    assert sim.inputs[-2:] == ("engine1.throttle", "engine1.thrust_drive")
    assert sim.outputs[-1] == "engine1.thrust"
    assert sim.parameters[-3:] == ("term.engine1.thrust", "term.CL.basic", "term.Cm.qhat")
    assert sim.terms == ("engine1/thrust", "CL/basic", "Cm/qhat")
    for kind in (INPUT, OUTPUT, PARAMETER, TERM):
        names = [row.name for row in sim.entries(kind)]
        assert len(set(names)) == len(names)
        for row in sim.entries(kind):
            assert parse_unit(row.units)[1:] == (1.0, 0.0), row
            assert parse_unit(row.units)[0] == parse_unit(row.display_units)[0], row
            assert math.isfinite(row.value)
            if kind != TERM:
                assert row.description, row
    for name in sim.outputs:
        if "." not in name and name != "out_of_range":
            assert {row.name: row.units for row in sim.entries(OUTPUT)}[name] == lookup(name).units


def test_flags_and_ranges():
    sim = flightmech.compile(
        aircraft(limits={"delta_e": (-0.3, 0.2)}), tree(CL__basic=make_term(0.4))
    )
    parameters = {row.name: row for row in sim.entries(PARAMETER)}
    assert parameters["mode.trim"].flags == FIXED | INTEGER
    assert parameters["init.h"].flags == FIXED
    assert parameters["mass.mass"].flags == 0
    assert parameters["mass.mass"].value == 500.0
    inputs = {row.name: row for row in sim.entries(INPUT)}
    assert (inputs["delta_e"].low, inputs["delta_e"].high) == (-0.3, 0.2)
    assert (inputs["gear"].low, inputs["gear"].high) == (0.0, 1.0)


def test_engine_leaf_may_not_depend_on_what_it_makes():
    engine = flightmech.aircraft.Engine((0.0, 0.0, 0.0), thrust=make_term(1.0, regressors=["dnz"]))
    assert refused(tree(CL__a=make_term(1.0)), engines=(engine,)) == [
        "engine1/thrust: regressor: dnz is found only after this table is evaluated; it "
        "cannot depend on it"
    ]


def test_every_vocabulary_variable_of_the_kernel_is_known():
    for name in computable_names(VARIABLE):
        assert name.group or lookup(name.pattern)


def test_provenance_travels_in_the_block():
    sim = flightmech.compile(
        aircraft(), tree({"source": "wind tunnel"}, CL__basic=make_term(0.4, comment="guess"))
    )
    assert sim.title == "glider"
    assert sim.meta["database"]["source"] == "wind tunnel"
    assert sim.meta["terms"]["CL/basic"] == {"comment": "guess"}


def test_a_tree_and_its_file_compile_to_the_same_block(tmp_path):
    written = tree(
        {"S": 15, "revision": 3, "flights": 12.5, "source": "wind tunnel"}, CL__basic=make_term(0.4)
    )
    written.to_netcdf(tmp_path / "db.nc", engine="h5netcdf")
    read = xr.open_datatree(tmp_path / "db.nc", engine="h5netcdf")
    assert isinstance(read.attrs["revision"], np.integer)
    blocks = [flightmech.compile(aircraft(), db) for db in (written, read)]
    assert blocks[1].meta["database"] == {
        "S": 15,
        "revision": 3,
        "flights": 12.5,
        "source": "wind tunnel",
    }
    assert blocks[0].block == blocks[1].block


def test_range_and_sources_of_each_term_travel_in_the_block():
    flap = xr.DataArray([0.5, 1.0], {"delta_f": np.radians([0.0, 40.0])}, ("delta_f",))
    alpha = np.radians([-8.0, 0.0, 20.0])
    leaf = make_term(
        np.ones((3, 2)), {"alpha": alpha, "mach": [0.1, 0.6]}, ["qhat"], K1=flap, source="datcom"
    )
    leaf["source"][1:, 0] = 1
    slice_ = make_term([0.3], {"h": [1524.0]}, source="judgement")
    terms = flightmech.compile(
        aircraft(), tree(Cm__qhat=leaf, CL__slice=slice_, CD__constant=make_term(0.02))
    ).meta["terms"]
    assert terms["Cm/qhat"] == {
        "axes": "delta_f 0 ... 40 deg (2), alpha -8 ... 20 deg (3), mach 0.1 ... 0.6 (2)",
        "source": "datcom 4, flight 2",
        "regressors": "qhat",
    }
    assert terms["CL/slice"] == {"axes": "h 5000 ft (1)", "source": "judgement 1"}
    assert terms["CD/constant"] == {}


@pytest.mark.parametrize("table", ["value", "K1", "K2"])
@pytest.mark.parametrize("axis", ["alphadothat", "betadothat", "dnz"])
def test_no_table_runs_over_what_the_simulation_solves_for(table, axis):
    """The loop through the force is closed by a linear solution, which is exact for regressors
    only.
    """
    over = xr.DataArray([0.0, 1.0], {axis: [0.0, 1.0]}, (axis,))
    leaf = (
        make_term([0.0, 1.0], {axis: [0.0, 1.0]})
        if table == "value"
        else make_term(1.0, **{table: over})
    )
    assert refused(tree(Cm__a=leaf)) == [
        f"Cm/a: {axis} cannot be an axis, the simulation solves for it; make it a regressor"
    ]


@pytest.mark.parametrize(
    "pair", [("dnz", "alphadothat"), ("betadothat", "dnz"), ("alphadothat", "alphadothat")]
)
def test_a_term_holds_one_of_what_the_simulation_solves_for(pair):
    text = "only one of alphadothat, betadothat, dnz can be solved for in a term"
    assert refused(tree(Cm__a=make_term(1.0, regressors=pair))) == [
        f"Cm/a: regressors {' '.join(pair)}: {text}"
    ]


def test_what_the_simulation_solves_for_may_be_scaled_by_anything_else():
    leaf = make_term([1.0, 2.0], {"mach": [0.1, 0.6]}, ["alphadothat", "alpha"])
    assert flightmech.compile(aircraft(), tree(Cm__a=leaf)).terms == ("Cm/a",)
