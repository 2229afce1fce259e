"""Arguments of calls are texts with units as in the files, or numbers in SI."""

import numpy as np
import pytest
import xarray as xr

import aerodb
import flightmech
from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.quantities import value_in_si
from flightmech.terms import make_term
from flightmech.units import FOOT, KNOT


@pytest.fixture(scope="module")
def toy():
    """An aeroplane that flies in a straight line: lift of alpha, no drag but that of lift."""
    aircraft = flightmech.Aircraft("toy", 17.0, 1.7, 10.3, 2300.0, 10800.0, 8100.0, 15100.0)
    tree = {
        "/CL/basic": make_term(5.0, regressors=["alpha"]),
        "/Cm/basic": make_term(-0.5, regressors=["alpha"]),
        "/Cm/elevator": make_term(-1.2, regressors=["delta_e"]),
    }
    return flightmech.compile(aircraft, xr.DataTree.from_dict(tree))


def test_a_trim_takes_texts_and_numbers_alike(trainer):
    stated = flightmech.trim(trainer, V_cas="170 kt", h="5000 ft")
    numbers = flightmech.trim(trainer, fixed={"V_cas": 170.0 * KNOT, "h": 5000.0 * FOOT})
    np.testing.assert_allclose(float(stated["alpha"]), float(numbers["alpha"]), rtol=1e-9)
    assert float(stated["h"]) == pytest.approx(1524.0)


def test_a_simulation_takes_texts(toy):
    inputs = xr.Dataset({"delta_e": ("time", [0.0, 0.0])}, {"time": [0.0, 0.1]})
    stated = flightmech.simulate(toy, inputs, {"init.V": "175 kt", "init.h": "5000 ft"})
    assert float(stated["V"][0]) == pytest.approx(175.0 * KNOT)
    assert float(stated["h"][0]) == pytest.approx(1524.0)


@pytest.mark.parametrize(
    ("quantities", "error", "words"),
    [
        ({"V_cas": "170 ft"}, UnitError, "V_cas = '170 ft'"),
        ({"V_cas": "170"}, UnitError, "expected a number and a unit"),
        ({"Vcas": "170 kt"}, UnknownName, "V_cas"),
        ({"V": 90.0, "fixed": {"V": 80.0}}, SchemaError, "give it once"),
    ],
)
def test_a_wrong_text_is_refused_with_its_name(toy, quantities, error, words):
    with pytest.raises(error, match=words):
        flightmech.trim(toy, **quantities)


def test_a_database_is_evaluated_at_texts():
    database = xr.DataTree.from_dict({"/CL/basic": make_term(5.0, regressors=["alpha"])})
    database.attrs["force_axes"] = "stability"
    stated = aerodb.evaluate(database, "CL", alpha="2 deg", mach=0.2)
    np.testing.assert_allclose(stated, 5.0 * np.radians(2.0))


def test_only_texts_are_converted():
    assert value_in_si(None, "m") is None
    samples = np.array([1.0, 2.0])
    assert value_in_si(samples, "m") is samples
