"""Values exchanged in a compiled model are those of a database compiled with them."""

import re

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.errors import SchemaError
from flightmech.simulation.node_values import table_values, with_table_values
from flightmech.terms import make_term

CRAFT = flightmech.Aircraft(
    name="glider", S=16.0, cbar=1.5, b=10.0, mass=900.0, Ixx=2000.0, Iyy=2500.0, Izz=4000.0
)
ALPHA, MACH = [-0.2, 0.0, 0.2, 0.4], [0.1, 0.3]
WIDE = np.array([[-0.8, 0.3, 1.3, 1.5], [-0.9, 0.2, 1.2, 1.6]])


def compiled(scale=1.0):
    leaves = {
        "CL/basic": make_term(scale * WIDE, {"mach": MACH, "alpha": ALPHA}),
        "CD/basic": make_term(
            0.1 * WIDE**2, {"mach": MACH, "alpha": ALPHA}
        ),  # side by side with the lift: the same axes
        "Cm/elevator": make_term(-1.2 * scale, regressors=["delta_e"]),
        "Cm/basic": make_term(scale * np.array([0.2, 0.03, -0.15, -0.4]), {"alpha": ALPHA}),
    }
    return flightmech.compile(
        CRAFT, xr.DataTree.from_dict({f"/{name}": leaf for name, leaf in leaves.items()})
    )


SHAPES = {"CL/basic": (2, 4), "Cm/elevator": (), "Cm/basic": (4,)}


def test_the_block_is_that_of_the_changed_database():
    sim = compiled()
    values = table_values(sim, SHAPES)
    assert np.array_equal(values["CL/basic"], WIDE)
    assert values["Cm/elevator"] == -1.2
    twice = with_table_values(sim, {name: 2.0 * found for name, found in values.items()})
    assert twice.block == compiled(2.0).block
    assert sim.block == compiled().block  # the model itself is left as it is
    assert with_table_values(sim, {}).block == sim.block


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        ("CL/basic", (2, 3)),
        ("CL/basic", (8,)),
        ("CL/gear", ()),
        ("Cm/basic", (5,)),
        ("CL/basic", ()),
    ],
)
def test_another_table_is_refused(name, shape):
    with pytest.raises(SchemaError, match=re.escape(f"no term {name} with a table of")):
        table_values(compiled(), {name: shape})


def test_values_that_are_not_finite_are_refused():
    with pytest.raises(SchemaError, match="Cm/basic holds values that are not finite"):
        with_table_values(compiled(), {"Cm/basic": np.array([0.0, np.nan, 0.0, 0.0])})
