"""Databases of similar aircraft: coefficients kept, lengths changed, uncertainty inflated,
everything reported.
"""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import aerodb
from aerodb.edit.rescaling import GROUPS, WIDENING
from flightmech import terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError, UnknownName


@pytest.fixture
def known():
    return Aircraft(
        "test", 16.9, 1.667, 10.31, 2400.0, 1.0e4, 8e3, 1.5e4, reference=(-3.0, 0.0, 0.0)
    )


@pytest.fixture
def larger(known):
    return replace(
        known, name="larger", S=4 * 16.9, cbar=2 * 1.667, b=2 * 10.31, reference=(-6.0, 0.0, 0.0)
    )


@pytest.fixture
def db(small):
    ground = terms.make_term(
        [[0.1, 0.0]], {"alpha": [0.0], "h_agl": [2.0, 20.0]}, stderr=0.0, source="datcom"
    )
    gear = xr.DataArray([1.0, 0.0], coords={"h_agl": [1.0, 10.0]}, dims="h_agl")
    more = {
        "CL/ground": ground,
        "Cm/ground": terms.make_term(0.02, K1=gear),
        "Cm/elevator": terms.make_term(-1.2, regressors=["delta_e"], stderr=0.1, source="flight"),
        "CD/basic": terms.make_term(
            [0.02, 0.05], {"alpha": [0.0, 0.2]}, stderr=0.003, source="flight"
        ),
    }
    return aerodb.replace_terms(small, more)


NOTHING = dict.fromkeys(WIDENING, (0.0, 0.0))


def test_one_keeps_every_number(db, known):
    same = aerodb.transform.rescale(db, known, widening=NOTHING)
    for name, leaf in aerodb.terms(db).items():
        xr.testing.assert_equal(aerodb.terms(same)[name][["value"]], leaf[["value"]])
        if "stderr" in leaf:
            np.testing.assert_allclose(
                aerodb.terms(same)[name]["stderr"], leaf["stderr"], rtol=1e-15
            )
    assert {key: same.attrs[key] for key in ("S", "cbar", "b", "x_ref", "force_axes")} == {
        key: db.attrs[key] for key in ("S", "cbar", "b", "x_ref", "force_axes")
    }


def test_there_and_back(db, known, larger):
    back = aerodb.transform.rescale(
        aerodb.transform.rescale(db, larger, {"Cm/elevator": 2.0}, NOTHING),
        known,
        {"Cm/elevator": 0.5},
        NOTHING,
    )
    for name, leaf in aerodb.terms(db).items():
        xr.testing.assert_allclose(aerodb.terms(back)[name][["value"]], leaf[["value"]], rtol=1e-14)


def test_lengths_change_and_coefficients_stay(db, larger):
    found = aerodb.transform.rescale(db, larger)
    assert aerodb.check(found) == []
    assert (found.attrs["S"], found.attrs["cbar"], found.attrs["b"], found.attrs["x_ref"]) == (
        4 * 16.9,
        2 * 1.667,
        2 * 10.31,
        -6.0,
    )
    assert found.attrs["aircraft"] == "larger"
    np.testing.assert_array_equal(found["CL/basic"]["value"], db["CL/basic"]["value"])
    assert found["CL/ground"]["h_agl"].values.tolist() == [4.0, 40.0]  # heights go with the span
    assert found["CL/ground"]["h_agl"].attrs["units"] == "m"
    assert found["Cm/ground"]["K1"]["h_agl"].values.tolist() == [2.0, 20.0]


def test_standard_errors_widen_and_sources_are_judgement(db, larger):
    found = aerodb.transform.rescale(db, larger)
    old, new = db["CL/basic"], found["CL/basic"]
    np.testing.assert_allclose(
        new["stderr"],
        np.sqrt(old["stderr"] ** 2 + (0.05 * old["value"]) ** 2 + 0.02**2),
        rtol=1e-12,
    )
    assert (
        float(found["CL/ground"]["stderr"][0, 1]) == 0.0
    )  # an increment that is zero stays certain
    assert float(found["Cm/elevator"]["stderr"]) == pytest.approx(np.hypot(0.1, 0.15 * 1.2))
    for leaf in aerodb.terms(found).values():
        assert (leaf["source"] == terms.SOURCES.index("judgement")).all()
        assert "rescale: from test to larger, span ratio 2" in leaf.attrs["history"]
    assert "rescale: from test to larger" in found.attrs["history"]
    own = aerodb.transform.rescale(db, larger, widening={"CL": (0.0, 0.1)})
    np.testing.assert_allclose(own["CL/basic"]["stderr"], np.hypot(old["stderr"], 0.1), rtol=1e-12)


def test_factors_on_terms_and_groups(db, larger):
    found = aerodb.transform.rescale(
        db, larger, {"horizontal_tail": 1.2, "Cm/qhat": 1.5}, note="longer tail"
    )
    assert float(found["Cm/elevator"]["value"]) == pytest.approx(-1.44)
    assert float(found["Cm/qhat"]["value"]) == pytest.approx(-17.0 * 1.2 * 1.5)
    np.testing.assert_array_equal(found["CD/basic"]["value"], db["CD/basic"]["value"])
    assert "horizontal_tail times 1.2; Cm/qhat times 1.5 (longer tail)" in found.attrs["history"]


def test_bad_factors_are_refused(db, larger):
    with pytest.raises(
        UnknownName, match="unknown term or group 'horizontal_tale'; near it: horizontal_tail"
    ):
        aerodb.transform.rescale(db, larger, {"horizontal_tale": 1.2})
    with pytest.raises(SchemaError, match="Cm/qhat is nan; give a finite number"):
        aerodb.transform.rescale(db, larger, {"Cm/qhat": float("nan")})
    with pytest.raises(SchemaError, match=r"CL is \(-0.1, 0.0\); give \(relative, absolute\)"):
        aerodb.transform.rescale(db, larger, widening={"CL": (-0.1, 0.0)})
    with pytest.raises(UnknownName, match="unknown coefficient 'CT'"):
        aerodb.transform.rescale(db, larger, widening={"CT": (0.1, 0.0)})


def test_groups_share_no_term():
    names = [name for group in GROUPS.values() for name in group]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("variable", ["q", "V", "qbar", "engine1.thrust"])
def test_a_term_over_a_quantity_of_the_known_size_is_refused(variable, db, larger):
    """A pitch rate of 0.1 rad/s is another reduced rate on an aircraft of twice the size."""
    more = {"Cm/more": terms.make_term(-1.0, regressors=[variable], stderr=0.1)}
    with pytest.raises(SchemaError, match=rf"Cm/more depends on {variable} \["):
        aerodb.transform.rescale(aerodb.replace_terms(db, more), larger)
