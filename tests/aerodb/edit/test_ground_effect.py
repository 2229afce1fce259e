"""Ground effect in closed form: LR-743 eq. (13) and (14) with table 2, its tables, and its way
through the database.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import aerodb
import flightmech
from aerodb.edit.ground_effect import bank_in_ground_effect, in_ground_effect, with_height_table
from aerodb.store import templates
from flightmech import terms
from flightmech.errors import SchemaError
from flightmech.simulation.kernel import Simulation
from flightmech.terms import PowerFactor

# LR-743 table 2, 40 deg of flap, heights in m: y_inf, k, s
CL_0, CL_ALPHA = (0.827, 0.599, -1.45), (4.87, 0.506, -1.75)
ROLL = (-0.078, -1.09)
FLOOR = 1.7  # lowest height of Fig. 17
PUBLISHED = (
    Path(__file__).parents[3]
    / ".."
    / "shared"
    / "data"
    / "published"
    / "lr743_table2_ground_effect.csv"
)


def leaves() -> dict[str, xr.Dataset]:
    return {
        "CL/basic": terms.make_term(CL_0[0], stderr=0.02, source="flight"),
        "CL/alpha": terms.make_term(CL_ALPHA[0], regressors=["alpha"], stderr=0.1, source="flight"),
        "CL/ground": in_ground_effect(
            terms.make_term(CL_0[0], stderr=0.02, source="flight"), *CL_0[1:], FLOOR
        ),
        "CL/ground_alpha": in_ground_effect(
            terms.make_term(CL_ALPHA[0], regressors=["alpha"], stderr=0.1), *CL_ALPHA[1:], FLOOR
        ),
        "Cl/ground": bank_in_ground_effect(*ROLL, FLOOR),
    }


@pytest.fixture
def ground() -> xr.DataTree:
    facts = {
        "title": "ground",
        "aircraft": "Citation 500",
        "S": 24.2,
        "cbar": 2.06,
        "b": 14.4,
        "x_ref": 0.0,
        "y_ref": 0.0,
        "z_ref": 0.0,
    }
    return aerodb.make_database(leaves(), **facts, force_axes="stability")


def test_table_2_as_published():
    if not PUBLISHED.is_file():
        pytest.skip("../shared/data/published is not there")
    rows = {
        row["term"]: row
        for row in csv.DictReader(PUBLISHED.read_text(encoding="utf-8").splitlines())
    }
    for name, numbers in (("CL0", CL_0), ("CLalpha", CL_ALPHA)):
        assert tuple(float(rows[name][key]) for key in ("y_inf", "k", "s")) == numbers
    assert (float(rows["CL*phi"]["k"]), float(rows["CL*phi"]["s"])) == ROLL


@pytest.mark.parametrize("h", [8.5, 3.0, 2.0])
def test_lift_of_table_2_at_the_heights_of_figure_16(ground, h):
    alpha = np.radians(5.0)
    found = aerodb.contributions(ground, "CL", {"alpha": alpha, "h_agl": h})
    assert found["ground"] == pytest.approx(0.599 * 0.827 * h**-1.45, rel=1e-14)
    assert found["ground_alpha"] == pytest.approx(0.506 * 4.87 * alpha * h**-1.75, rel=1e-14)


def test_numbers_worked_out_by_hand(ground):
    """At 2 m: 0.599 x 0.827 x 0.3660 = 0.1813; 0.506 x 4.87 x 0.2973 = 0.7326 per rad; 327 m is
    free air to 1.2e-4.
    """
    at = {"alpha": 0.1, "h_agl": np.array([2.0, 327.0])}
    found = aerodb.contributions(ground, "CL", at)
    np.testing.assert_allclose(found["ground"], [0.18132, 1.1197e-4], rtol=1e-3)
    np.testing.assert_allclose(found["ground_alpha"][0], 0.07326, rtol=1e-3)


def test_rolling_moment_takes_the_lift_of_the_moment(ground):
    """CL is the sum of the lift terms unless it is given; the moment acts against the bank."""
    at = {"alpha": 0.1, "h_agl": 3.0, "phi": np.radians(5.0)}
    lift = float(aerodb.evaluate(ground, "CL", alpha=0.1, h_agl=3.0))
    expected = -0.078 * 3.0**-1.09 * lift * np.radians(5.0)
    assert float(aerodb.evaluate(ground, "Cl", **at)) == pytest.approx(expected, rel=1e-14)
    given = float(aerodb.evaluate(ground, "Cl", CL=1.0, h_agl=3.0, phi=np.radians(5.0)))
    assert given == pytest.approx(expected / lift, rel=1e-14)


def test_the_simulation_computes_the_same():
    """Identity: kernel and database agree, the exponent and the scale are parameters by name."""
    body = flightmech.Aircraft("c500", 24.2, 2.06, 14.4, 5000.0, 15000.0, 20000.0, 33000.0)
    db = xr.DataTree.from_dict({f"/{name}": leaf for name, leaf in leaves().items()})
    sim = flightmech.compile(body, db)
    exponent = sim.parameters.index("power.CL.ground")
    for phi, h, s in ((0.1, 3.0, -1.45), (-0.2, 1.0, -1.45), (0.1, 8.5, -1.2)):
        run = Simulation(sim.model)
        for name, value in {
            "init.V": 60.0,
            "init.alpha": 0.08,
            "init.phi": phi,
            "init.h": h,
        }.items():
            run.set_parameter(sim.parameters.index(name), value)
        run.set_parameter(exponent, s)
        run.initialize()
        y = dict(zip(sim.outputs, run.outputs(), strict=True))
        at = {"alpha": y["alpha"], "h_agl": y["h_agl"], "phi": y["phi"]}
        changed = {**leaves(), "CL/ground": leaves()["CL/ground"].assign_attrs(exponent=s)}
        lift = sum(
            float(terms.evaluate_term(leaf, at))
            for name, leaf in changed.items()
            if name.startswith("CL")
        )
        assert y["CL"] == pytest.approx(lift, rel=1e-12)
        assert y["Cl"] == pytest.approx(
            float(terms.evaluate_term(changed["Cl/ground"], {**at, "CL": lift})), rel=1e-12
        )


def test_height_table_is_the_formula():
    closed = in_ground_effect(
        terms.make_term([0.1, 0.8], {"delta_f": [0.0, 0.7]}, stderr=0.01), 0.6, -1.45, 2.0
    )
    table = with_height_table(closed, top=60.0, tolerance=1e-3)
    assert terms.power_factor(table) is None
    assert table["K1"].attrs["formula"] == "max(h_agl, 2)^-1.45"
    h = np.geomspace(2.0, 60.0, 2000)
    exact = terms.evaluate_term(closed, {"delta_f": 0.7, "h_agl": h})
    off = terms.evaluate_term(table, {"delta_f": 0.7, "h_agl": h}) / exact - 1.0
    assert (
        0.5e-3 < off.max() < 1e-3
    )  # a line lies above a power with negative exponent; fewer breakpoints would be off by more
    assert off.min() > -1e-12
    np.testing.assert_allclose(
        terms.evaluate_term(table, {"delta_f": 0.7, "h_agl": 0.0}, outside="clamp"),
        0.6 * 0.8 * 2.0**-1.45,
    )
    assert len(table["h_agl"]) == 73


def test_height_table_of_a_term_that_goes_on_linearly_is_refused():
    """A table over the height would go on to -0.053 at 1000 m, where the formula has 6.7e-6."""
    flap = terms.make_term([0.1, 0.2], {"delta_f": [0.0, 0.1]}, outside="linear")
    closed = in_ground_effect(flap, 1.0, -1.45, 2.0)
    with pytest.raises(SchemaError, match="goes on linearly beyond its tables"):
        with_height_table(closed, top=30.0)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: in_ground_effect(terms.make_term(0.8), np.nan, -1.0, 2.0), "k is nan"),
        (
            lambda: in_ground_effect(leaves()["CL/ground"], 0.5, -1.0, 2.0),
            "has a power factor already",
        ),
        (
            lambda: in_ground_effect(
                terms.make_term([0.1, 0.0], {"h_agl": [0.0, 9.0]}), 0.5, -1.0, 2.0
            ),
            "depends on a height",
        ),
        (
            lambda: in_ground_effect(terms.make_term(0.8), 0.5, -1.0, 0.0),
            "floor is 0; it must be positive",
        ),
        (lambda: bank_in_ground_effect(-0.078, np.inf, 2.0), "exponent is inf"),
        (lambda: with_height_table(terms.make_term(0.8), 30.0), "has no power factor"),
        (lambda: with_height_table(leaves()["CL/ground"], 1.0), "give more than the floor of 1.7"),
        (
            lambda: with_height_table(leaves()["CL/ground"], 30.0, 0.0),
            "give a share between 0 and 1",
        ),
    ],
)
def test_what_makes_no_ground_effect_is_refused(make, text):
    with pytest.raises(SchemaError) as caught:
        make()
    assert text in str(caught.value)


def test_scheme_takes_a_power_for_the_height():
    leaf = templates.make("CL/ground", value=0.5, power=PowerFactor("h_agl", -1.45, 2.0))
    assert terms.power_factor(leaf) == PowerFactor("h_agl", -1.45, 2.0)
    with pytest.raises(SchemaError, match="or a power of it"):
        templates.make("CL/ground", value=0.5)


# ---- through the database
# -------------------------------------------------------------------------------------------


def same_power(db: xr.DataTree) -> None:
    assert terms.power_factor(aerodb.terms(db)["CL/ground"]) == PowerFactor("h_agl", -1.45, FLOOR)
    assert terms.list_regressors(aerodb.terms(db)["Cl/ground"]) == ("CL", "phi")


@pytest.mark.slow
def test_files_keep_the_power(ground, tmp_path):
    aerodb.save(ground, tmp_path / "a.nc")
    aerodb.exchange.export_csv(ground, tmp_path / "csv")
    aerodb.exchange.export_matlab(ground, tmp_path / "a.mat")
    for db in (
        aerodb.open(tmp_path / "a.nc"),
        aerodb.exchange.import_csv(tmp_path / "csv"),
        aerodb.exchange.import_matlab(tmp_path / "a.mat"),
    ):
        same_power(db)
        xr.testing.assert_identical(
            aerodb.terms(db)["CL/ground_alpha"], aerodb.terms(ground)["CL/ground_alpha"]
        )


def test_check_cases_see_both_sides_of_the_floor(ground, tmp_path):
    cases = tmp_path / "cases.csv"
    aerodb.exchange.export_checkcases(ground, cases)
    assert aerodb.exchange.run_checkcases(ground, cases)["agrees"].all()
    for change in ({"exponent": -1.4}, {"floor": 1.8}):
        other = aerodb.replace_terms(
            ground, {"CL/ground": leaves()["CL/ground"].assign_attrs(change)}
        )
        found = aerodb.exchange.run_checkcases(other, cases)
        assert set(found.index[~found["agrees"]]) == {
            "CL/ground",
            "CL",
            "Cl/ground",
            "Cl",
        }  # the lift goes into the rolling moment


def test_exports_without_formulas_refuse_it(ground, tmp_path):
    body = flightmech.Aircraft("Citation 500", 24.2, 2.06, 14.4, 5000.0, 15000.0, 20000.0, 33000.0)
    with pytest.raises(
        SchemaError,
        match=r"CL/ground: the factor max\(h_agl, 1.7\)\^-1.45 is a formula.*with_height_table",
    ):
        aerodb.exchange.export_daveml(ground, tmp_path / "a.dml")
    with pytest.raises(
        SchemaError,
        match=r"CL/ground: the factor max\(h_agl, 1.7\)\^-1.45 is a formula.*with_height_table",
    ):
        aerodb.exchange.export_jsbsim(ground, tmp_path / "a.xml", body)
    assert not list(tmp_path.iterdir())
    tabled = {
        name: with_height_table(leaf, 60.0)
        for name, leaf in aerodb.terms(ground).items()
        if name.startswith("CL/ground")
    }
    aerodb.exchange.export_daveml(
        aerodb.delete_terms(aerodb.replace_terms(ground, tabled), ["Cl/ground"]), tmp_path / "a.dml"
    )
    again = aerodb.exchange.import_daveml(tmp_path / "a.dml")
    h = np.array([1.0, 2.0, 5.0, 40.0])
    found, expected = (
        aerodb.evaluate(db, "CL", "clamp", alpha=0.1, h_agl=h) for db in (again, ground)
    )
    np.testing.assert_allclose(found, expected, rtol=1e-3)


def test_terms_with_other_powers_are_not_the_same_table(ground):
    other = aerodb.replace_terms(
        ground, {"CL/ground": leaves()["CL/ground"].assign_attrs(exponent=-1.2)}
    )
    row = aerodb.compare(ground, other).loc["CL/ground"]
    assert row["note"] == "regressors differ: max(h_agl, 1.7)^-1.45 in a, max(h_agl, 1.7)^-1.2 in b"
    whole = aerodb.compare(ground, other).loc["CL"]
    assert whole["max_difference"] == pytest.approx(
        0.599 * 0.827 * (2.0**-1.2 - 2.0**-1.45), rel=1e-9
    )
    assert "h_agl 6.562 ft" in whole["location"]
    with pytest.raises(SchemaError, match="only tables of the same meaning can be joined"):
        aerodb.edit.blend(ground, other, names=["CL/ground"])


def test_edits_keep_the_power(ground):
    same_power(aerodb.edit.scale(ground, "CL/ground", 1.1))
    flapped = {
        "CL/ground": in_ground_effect(
            terms.make_term([0.3, 0.8], {"delta_f": [0.0, 0.5]}, stderr=0.02), 0.6, -1.45, FLOOR
        )
    }
    longer = aerodb.edit.extend(
        aerodb.replace_terms(ground, flapped), "CL/ground", "delta_f", [0.7]
    )
    same_power(longer)
    assert float(
        aerodb.contributions(longer, "CL", {"alpha": 0.0, "delta_f": 0.7, "h_agl": 3.0})["ground"]
    ) == pytest.approx(0.6 * 0.8 * 3.0**-1.45, rel=1e-14)


def test_moving_the_reference_along_keeps_the_power_and_down_refuses_it(ground):
    moved = aerodb.transform.move_reference(ground, (0.3, 0.0, 0.0))
    same_power(moved)
    assert terms.power_factor(aerodb.terms(moved)["Cm/ground"]) == PowerFactor(
        "h_agl", -1.45, FLOOR
    )
    with pytest.raises(
        SchemaError,
        match=r"CL/ground: the factor max\(h_agl, 1.7\)\^-1.45 cannot be counted from a point",
    ):
        aerodb.transform.move_reference(ground, (0.0, 0.0, 0.2))


def test_similar_aircraft_has_the_effect_at_the_same_height_in_spans(ground):
    body = flightmech.Aircraft("half", 24.2 / 4.0, 1.03, 7.2, 600.0, 500.0, 600.0, 1100.0)
    scaled = aerodb.transform.rescale(ground, body)
    for h in (0.5, 3.0, 20.0):
        found = aerodb.contributions(scaled, "CL", {"alpha": 0.1, "h_agl": 0.5 * h})
        expected = aerodb.contributions(ground, "CL", {"alpha": 0.1, "h_agl": h})
        assert float(found["ground"]) == pytest.approx(float(expected["ground"]), rel=1e-13)
    tabled = aerodb.replace_terms(
        ground, {"CL/ground": with_height_table(leaves()["CL/ground"], 60.0)}
    )
    assert (
        "formula"
        not in aerodb.terms(aerodb.transform.rescale(tabled, body))["CL/ground"]["K1"].attrs
    )


def test_summary_and_figures_state_the_power(ground):
    assert "max(h_agl, 1.7)^-1.45" in aerodb.summary(ground)
    flapped = in_ground_effect(
        terms.make_term([0.3, 0.8], {"delta_f": [0.0, 0.7]}, stderr=0.02), 0.6, -1.45, 2.0
    )
    figure = aerodb.figures.plot_term(
        aerodb.replace_terms(ground, {"CL/ground": flapped}), "CL/ground"
    )
    words = " ".join(
        text.get_text() for text in figure.findobj(lambda item: hasattr(item, "get_text"))
    )
    assert r"\max(" in words
    assert "^{-1.45}" in words
