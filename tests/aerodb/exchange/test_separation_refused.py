"""Terms of the flow separation: formats without its state refuse them by name."""

from __future__ import annotations

import pytest

import aerodb
import flightmech
from flightmech.errors import SchemaError
from flightmech.terms import make_term


def test_jsbsim_and_daveml_name_the_term_and_the_state(tmp_path, root):
    leaves = {
        "CL/alpha": make_term(4.8, regressors=["alpha"], source="estimate"),
        "CL/stall": make_term([-3.0, 0.0], {"X_lift": [0.25, 1.0]}, ["alpha"], source="flight"),
    }
    db = aerodb.make_database(leaves, **root)
    sizes = {name: root[name] for name in ("S", "cbar", "b")}
    inertia = {"mass": 2400.0, "Ixx": 10800.0, "Iyy": 8100.0, "Izz": 15100.0}
    craft = flightmech.Aircraft("jet", **sizes, **inertia)
    expected = "CL/stall: X_lift is a state of the flow"
    with pytest.raises(SchemaError, match=expected):
        aerodb.exchange.export_jsbsim(db, tmp_path / "jet.xml", craft)
    with pytest.raises(SchemaError, match=expected):
        aerodb.exchange.export_daveml(db, tmp_path / "jet.dml")
    assert not list(tmp_path.iterdir())
