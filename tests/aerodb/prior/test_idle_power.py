"""Tests of listings without thrust and of listings without altitude, of one aircraft of two
engines.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import aerodb
import datcom_io
from aerodb.prior.roles import assign_roles
from flightmech.errors import AeromatchWarning

LISTINGS = Path(__file__).parents[1] / "listings"
# printed pitch damping of this aircraft lies at the pole of the method
pytestmark = pytest.mark.filterwarnings("ignore:.*suspect")


@pytest.fixture(scope="module")
def two_engines(craft):
    """Return the aircraft of the decks."""
    numbers = {"S": 18.6, "cbar": 1.62, "b": 11.8, "reference": (-4.1, 0.0, -0.1)}
    return dataclasses.replace(craft, name="two engines", **numbers)


@pytest.fixture(scope="module")
def read():
    """Return a reader of the listings by name."""
    return lambda name: datcom_io.read(LISTINGS / f"{name}.out")


@pytest.mark.slow
def test_engines_without_thrust_give_the_clean_aeroplane(two_engines, read) -> None:
    idle = read("idle_jet")
    assert [item.roles for item in assign_roles([idle])] == [("clean",)]
    clean = aerodb.from_datcom(two_engines, clean=read("two_engines"))
    with pytest.warns(AeromatchWarning, match="jet engines of zero thrust: its pages count as"):
        db = aerodb.from_datcom(two_engines, clean=idle)
    difference = db["Cm/basic"]["value"] - clean["Cm/basic"]["value"]
    # the normal force of the inlets: at most 0.026 in Cm, which the standard error covers
    assert 0.01 < float(np.abs(difference).max()) < 0.03
    widened = np.hypot(clean["Cm/basic"]["stderr"].values, 0.03)
    assert (db["Cm/basic"]["stderr"].values > 0.9 * widened).all()
    assert np.allclose(db["Cn/beta"]["value"], clean["Cn/beta"]["value"])


@pytest.mark.nightly
def test_stating_that_they_are_powered_changes_nothing(two_engines, read) -> None:
    with pytest.warns(AeromatchWarning, match="zero thrust"):
        plain = aerodb.from_datcom(two_engines, clean=read("idle_jet"))
    with pytest.warns(AeromatchWarning, match="zero thrust"):
        stated = aerodb.from_datcom(two_engines, clean=read("idle_jet"), powered=True)
    assert plain.identical(stated)


@pytest.mark.nightly
@pytest.mark.parametrize("altitude", [None, 1500.0])
def test_tables_over_mach_number_need_no_altitude(two_engines, read, altitude) -> None:
    with pytest.warns(AeromatchWarning, match="state no altitude"):
        db = aerodb.from_datcom(two_engines, clean=read("reynolds"), altitude=altitude)
    leaf = db["CL/basic"]
    assert leaf["value"].dims == ("mach", "alpha")
    assert leaf["mach"].values.tolist() == [0.0, 0.2, 0.35]
    assert "at the Reynolds numbers of the deck" in leaf.attrs["comment"]
