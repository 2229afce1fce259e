"""Power effects against the pages with and without power.

Increments are differences of two prints; they come back exactly, because the printed decimals go
through unchanged.
"""

import dataclasses

import numpy as np
import pytest

import aerodb
from flightmech.errors import AeromatchWarning, SchemaError
from flightmech.units import DEGREE

CT = 2 * 0.08  # ce500_jet.inp: NENGSJ 2, THSTCJ 0.08 each
INLET = "power: the inlet lies behind the apex of the wing"


@pytest.fixture(scope="module")
def pages(corpus):
    """Return the jet with power, and the same aeroplane at the same Mach numbers without."""
    return {"clean": corpus("ce500_elevator"), "power": corpus("ce500_jet")}


@pytest.fixture(scope="module")
def powered(jet, pages):
    with pytest.warns(AeromatchWarning, match=INLET):
        return aerodb.from_datcom(jet, **pages, altitude=0.0)


def table(db, name, mach, alpha):
    return float(db[name]["value"].sel(mach=mach, alpha=alpha, method="nearest", tolerance=1e-6))


@pytest.mark.slow
def test_the_thrust_itself_is_taken_off(powered, pages, jet):
    """ce500_jet.out, Mach 0.2, alpha 8: CL 1.022, CM -0.1314; exit at 0.65, moment centre at -0.15
    m.
    """
    free = (
        pages["clean"][0]
        .to_datatree()["static"]
        .to_dataset()
        .isel(condition=0)
        .sel(alpha=8 * DEGREE, method="nearest")
    )
    lift = CT * (table(powered, "CL/power", 0.2, 8 * DEGREE) + np.sin(8 * DEGREE))
    moment = CT * (table(powered, "Cm/power", 0.2, 8 * DEGREE) - 0.8 / jet.cbar)
    assert lift == pytest.approx(1.022 - float(free["CL"]), abs=1e-12)
    assert moment == pytest.approx(-0.1314 - float(free["Cm"]), abs=1e-12)
    assert powered["CL/power"].attrs["regressors"] == "CT"
    assert "thrust itself taken off" in powered["CL/power"].attrs["comment"]


def test_cells_without_value_hold_no_increment(powered):
    """CM -0.0699 at alpha 18, Mach 0.2, is the increment alone; the page without power has NA
    there.
    """
    assert "alpha 18 20 22 deg not printed" in powered["Cm/power"].attrs["comment"]
    source = powered["Cm/power"]["source"].sel(mach=0.2)
    held, printed = (int(source.sel(alpha=alpha * DEGREE, method="nearest")) for alpha in (22, 16))
    assert (held, printed) == (2, 0)


def test_jets_give_no_drag(powered):
    assert "CD/power" in powered.attrs["absent"].split()


@pytest.mark.nightly
def test_force_per_thrust_does_not_depend_on_the_reference_area(jet, pages, powered):
    with pytest.warns(AeromatchWarning):
        other = aerodb.from_datcom(dataclasses.replace(jet, S=48.4), **pages, altitude=0.0)
    np.testing.assert_allclose(other["CL/power"]["value"], powered["CL/power"]["value"], rtol=1e-14)
    np.testing.assert_allclose(
        other["CL/basic"]["value"], 0.5 * powered["CL/basic"]["value"], rtol=1e-14
    )


@pytest.mark.nightly
def test_power_must_be_known_and_comparable(jet, corpus, pages):
    clean, power = corpus("ce500_clean"), pages["power"]
    with (
        pytest.warns(AeromatchWarning, match=INLET),
        pytest.raises(SchemaError, match=r"Mach 0\.2, 0\.4 stands on no page without power"),
    ):
        aerodb.from_datcom(jet, clean=clean, power=power, altitude=0.0)
    with pytest.raises(SchemaError, match="computed with power jet; give the case without JETPWR"):
        aerodb.from_datcom(jet, clean=power)
    with pytest.raises(SchemaError, match="the input cards hold no JETPWR or PROPWR"):
        aerodb.from_datcom(jet, clean=clean, power=clean)
    with pytest.raises(
        SchemaError,
        match="cbar, b, x_cg, z_cg of the powered pages are not those of the clean ones",
    ):
        aerodb.from_datcom(jet, clean=clean, power=corpus("cz150_like")[2])
    with pytest.raises(
        SchemaError, match="the trees hold no input cards; give the Listing or the Case itself"
    ):
        aerodb.from_datcom(jet, clean=clean, power=power[0].to_datatree())
    with (
        pytest.warns(AeromatchWarning, match=INLET),
        pytest.raises(SchemaError, match=r"stand at 0\.0 m, the clean listing has no page"),
    ):
        aerodb.from_datcom(jet, clean=_high(pages["clean"]), power=power)


def _high(listing):
    """Return the pages of a listing that do not stand at sea level."""
    tree = listing[0].to_datatree()
    for name, leaf in tree.children.items():
        dataset = leaf.to_dataset()
        if "condition" in dataset.dims:
            tree[name] = dataset.isel(condition=dataset["h"].values > 1.0)
    return tree


@pytest.mark.nightly
def test_propeller(craft, corpus):
    """cz150_like.out, Mach 0.05, alpha 8: CL, CD and CM grow by 0.043, 0.010 and 0.0119 at THSTCP
    0.1; the line meets the moment centre.
    """
    listing = corpus("cz150_like")
    at = listing[0].to_datatree().attrs
    plane = dataclasses.replace(
        craft, S=at["S"], cbar=at["cbar"], b=at["b"], reference=(-at["x_cg"], 0.0, -at["z_cg"])
    )
    db = aerodb.from_datcom(plane, clean=listing[0], power=listing[2])
    where = {"mach": 0.05, "alpha": 8 * DEGREE}
    assert table(db, "CL/power", **where) == pytest.approx(0.43 - np.sin(8 * DEGREE), abs=1e-12)
    assert table(db, "CD/power", **where) == pytest.approx(0.10, abs=1e-12)
    assert table(db, "Cm/power", **where) == pytest.approx(0.119, abs=1e-12)
    assert "alpha 20 deg not printed" in db["Cm/power"].attrs["comment"]
