"""Terms of fits that no table carries, by the t value and by what the tables can follow along the
samples.
"""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import aerodb
from aerodb.store.schema import make_database
from aerodb.store.undo_history import history, undo_edits
from aerodb.update.cautions.notices import incompatible_fits, notices_of
from aerodb.update.cautions.unplaced_terms import SIGNIFICANT, carried_share, unplaced_terms
from aerodb.update.classical_join import join_submodels
from aerodb.update.regression import regress_tables
from aerodb.update.tabulation import tabulate
from flightmech import terms
from flightmech.errors import AeromatchWarning, SchemaError, UnknownName

DEG = np.pi / 180.0
ROOT = dict(
    title="test",
    aircraft="test",
    S=16.0,
    cbar=1.6,
    b=10.0,
    x_ref=0.0,
    y_ref=0.0,
    z_ref=0.0,
    force_axes="stability",
)
ALPHA = np.arange(-4.0, 13.0, 2.0) * DEG
NOISE = 0.002
TIME = np.arange(0.0, 12.0, 0.05)
MOTION = {
    "alpha": (3.0 + 2.0 * np.sin(TIME)) * DEG,
    "mach": 0.3 + 0.002 * np.cos(0.7 * TIME),
    "qhat": 0.002 * np.sin(2.3 * TIME),
    "delta_e": (-5.0 + 3.0 * np.cos(3.1 * TIME)) * DEG,
    "gear": np.ones(TIME.size),
}
SLOPES = {"1": 0.25, "alpha": 5.2, "qhat": 7.0, "delta_e": 0.45}


def leaf(value, axes=None, regressors=(), stderr=0.1, **more):
    return terms.make_term(value, axes or {}, regressors, stderr=stderr, source="datcom", **more)


def clean():
    """A database of a clean listing: no table depends on the elevator."""
    basic = 0.25 + 5.2 * ALPHA
    return {
        "CL/basic": leaf(basic, {"alpha": ALPHA}, stderr=0.05),
        "CL/qhat": leaf(7.0, {}, ["qhat"], stderr=2.0),
    }


def fit(
    model=tuple(SLOPES), systematic=0.0, name="multisine", coefficient="CL", noise=NOISE, **motion
):
    """Least squares of a coefficient that depends on alpha, pitch rate and elevator, as
    `aerodb.tabulate` takes it.
    """
    data = {**MOTION, **motion}
    columns = {
        "1": np.ones(TIME.size),
        "alpha**2": data["alpha"] ** 2,
        "delta_e**2": data["delta_e"] ** 2,
        **data,
    }
    z = sum(
        slope * columns[term] for term, slope in SLOPES.items()
    ) + noise * np.random.default_rng(1).normal(size=TIME.size)
    X = np.column_stack([columns[term] for term in model])
    covariance = max(noise, 1e-9) ** 2 * np.linalg.inv(X.T @ X)
    estimates = {
        "estimate": ("term", np.linalg.lstsq(X, z, rcond=None)[0]),
        "stderr": ("term", np.sqrt(np.diag(covariance))),
        "stderr_systematic": ("term", np.full(len(model), systematic)),
        "covariance": (("term", "term_"), covariance),
        "systematic": (("term", "error"), np.zeros((len(model), 0))),
    }
    attrs = {"coefficient": coefficient, "name": name}
    samples = xr.Dataset(
        {key: ("sample", value) for key, value in {**data, coefficient: z}.items()}
    )
    design = xr.DataArray(X, dims=("sample", "term"))
    found = xr.Dataset(estimates, {"term": list(model), "error": np.array([], str)}, attrs)
    return SimpleNamespace(name=name, estimates=found, data=samples, design=design)


def unplaced(leaves, *fits, held=()):
    return unplaced_terms(fits or [fit()], make_database(leaves, **ROOT), held)


WAYS = {
    "tabulate": tabulate,
    "join": join_submodels,
    "direct": lambda fits, db, **more: regress_tables(
        samples_of(fits), db, white, local=fits, **more
    ),
    "direct without fits": lambda fits, db, **more: regress_tables(
        samples_of(fits), db, white, **more
    ),
    "direct, published": lambda fits, db, **more: regress_tables(
        samples_of(fits), db, white, fits=fits, **more
    ),
}


def placed():
    return make_database({**clean(), "CL/elevator": leaf(0.5, {}, ["delta_e"])}, **ROOT)


def samples_of(fits):
    return [one.data.assign_attrs(coefficient="CL", name=one.name) for one in fits]


def white(samples, X, v):
    return float(v @ v) / (len(v) - X.shape[1]) * np.linalg.inv(X.T @ X)


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore:incompatible fits")
@pytest.mark.parametrize("way", WAYS)
def test_an_elevator_without_a_table_stops_every_way(way):
    """Term, estimate, t value and both remedies are in the text; with "warn" the same is a warning
    and stands in the history.
    """
    db = make_database(clean(), **ROOT)
    with pytest.raises(
        SchemaError,
        match=r"(?s)CL: delta_e of 'multisine'.*estimate 0\.4\d+ \+- .*t \d+.*listing for "
        r"elevator.*\[terms\.",
    ):
        WAYS[way]([fit()], db)
    with pytest.warns(AeromatchWarning, match=r"no place in the database.*delta_e of 'multisine'"):
        found = WAYS[way]([fit()], db, unplaced="warn")
    assert list(found.unplaced["term"]) == ["delta_e"] * len(found.unplaced)
    assert bool(found.unplaced["significant"].all())
    after = aerodb.replace_terms(db, found)
    assert any("delta_e of 'multisine'" in line for line in notices_of(after.attrs))
    assert [text for text in history(after)["text"] if text.startswith("warning: ")]
    assert "notices" not in undo_edits(after).attrs
    assert undo_edits(after).attrs.get("history", "") == db.attrs.get("history", "")


@pytest.mark.parametrize("way", ["tabulate", "join", "direct"])
def test_a_placed_elevator_is_no_problem(way):
    found = WAYS[way]([fit()], placed())
    assert not len(found.unplaced)
    assert found.notices == ()


def test_the_choice_is_one_of_two():
    with pytest.raises(UnknownName, match="unknown choice of unplaced 'ignore'"):
        tabulate([fit()], placed(), unplaced="ignore")


def test_the_errors_of_the_instruments_count_in_the_t_value():
    """An estimate within a few of its systematic errors is reported, and nothing stops."""
    row = unplaced(clean(), fit(systematic=0.2)).iloc[0]
    assert row["t"] < SIGNIFICANT
    assert not row["significant"]
    assert row["stderr"] == pytest.approx(0.2, rel=0.1)
    with pytest.warns(
        AeromatchWarning, match="incompatible"
    ):  # chi-squared of the declared covariance alone
        assert len(tabulate([fit(systematic=0.2)], make_database(clean(), **ROOT)).unplaced) == 1


BEYOND = np.array([0.0, 20.0, 40.0]) * DEG
CANNOT = {
    "breakpoints beyond the flown values": leaf([0.0, 0.2, 0.4], {"delta_e": BEYOND}),
    "nodes that are all zero and exact": leaf(
        [0.0, 0.0, 0.0], {"delta_e": BEYOND - 20.0 * DEG}, stderr=0.0
    ),
    "a term over something else": leaf(0.1, {}, ["delta_a"]),
    "another power": leaf(0.1, {}, ["qhat", "delta_e"]),
}
CAN = {
    "a slope": leaf(0.1, {}, ["delta_e"]),
    "a slope over alpha": leaf(np.full(ALPHA.size, 0.1), {"alpha": ALPHA}, ["delta_e"]),
    "a table": leaf(
        [-0.2, -0.1, 0.0, 0.1],
        {"delta_e": np.array([-20.0, -10.0, 0.0, 10.0]) * DEG},
        stderr=[0.1, 0.1, 0.0, 0.1],
    ),
    "a slope with the gear": leaf(0.1, {}, ["delta_e", "gear"]),
    "an exact slope": leaf(0.45, {}, ["delta_e"], stderr=0.0),
}


@pytest.mark.parametrize("kind", CANNOT)
def test_a_table_that_cannot_carry_the_elevator_is_no_place(kind):
    more = {"delta_a": 0.01 * np.sin(TIME)} if "else" in kind else {}
    found = unplaced({**clean(), "CL/elevator": CANNOT[kind]}, fit(**more))
    assert list(found["term"]) == ["delta_e"]
    assert bool(found["significant"].all())
    assert found["carried"].iloc[0] < 0.5


@pytest.mark.parametrize("kind", CAN)
def test_a_table_that_carries_the_elevator_is_a_place(kind):
    assert not len(unplaced({**clean(), "CL/elevator": CAN[kind]}))


def test_a_held_term_is_a_place():
    leaves = {**clean(), "CL/elevator": leaf(0.5, {}, ["delta_e"], stderr=0.0)}
    assert not len(unplaced(leaves, held=["CL/elevator"]))


def test_a_bend_finer_than_the_breakpoints_is_reported_only():
    """The square of alpha inside one cell: the straight part has its place in the table."""
    wide = {
        "CL/basic": leaf([-0.6, 1.2], {"alpha": ALPHA[[0, -1]]}),
        "CL/elevator": CAN["a slope"],
        "CL/qhat": clean()["CL/qhat"],
    }
    curved = fit(("1", "alpha", "alpha**2", "qhat", "delta_e"), noise=1e-12)
    found = unplaced(wide, curved)
    assert list(found["term"]) == ["alpha**2"]
    assert not found["significant"].any()


def test_a_square_of_the_elevator_needs_more_than_a_slope():
    square = fit(("1", "alpha", "qhat", "delta_e", "delta_e**2"))
    square.estimates["estimate"].values[-1] = 5.0
    found = unplaced({**clean(), "CL/elevator": CAN["a slope"]}, square)
    assert list(found["term"]) == ["delta_e**2"]
    assert bool(found["significant"].all())
    in_one_cell = unplaced({**clean(), "CL/elevator": CAN["a table"]}, square)
    assert not in_one_cell["significant"].any()
    fine = leaf(np.zeros(11), {"delta_e": np.linspace(-9.0, -1.0, 11) * DEG})
    assert not len(unplaced({**clean(), "CL/elevator": fine}, square))


def test_lift_carries_what_a_table_over_alpha_carries():
    """CD = 1 + CL**2, the polar of rest points, informs a table over alpha."""
    lift = 0.25 + 5.2 * MOTION["alpha"]
    data = fit(("1", "alpha**2"), coefficient="CD")
    data.estimates = data.estimates.assign_coords(term=["1", "CL**2"])
    data.design.values[:, 1] = lift**2
    data.data["CL"] = "sample", lift
    assert not len(unplaced({"CD/basic": leaf(0.02 + 0.0 * ALPHA, {"alpha": ALPHA})}, data))


def test_a_regressor_that_the_others_repeat_has_no_share_to_lose():
    x = np.sin(TIME)
    assert carried_share(np.column_stack([x, 2.0 * x]), 1, []) == 1.0
    assert carried_share(np.column_stack([np.cos(TIME), x]), 1, []) == pytest.approx(0.0)


@pytest.mark.slow
def test_incompatible_fits_are_a_warning_that_the_database_keeps(tmp_path):
    """Two fits of one place, 0.1 of lift away from each other with errors of 0.001."""
    other = fit(name="other")
    other.estimates["estimate"].values[0] += 0.1
    expected = r"CL \(chi-squared \d+.* of 8 estimates.*errors of the fits grow 87 times\)"
    with pytest.warns(AeromatchWarning, match=f"incompatible fits: {expected}"):
        found = tabulate([fit(), other], placed())
    assert incompatible_fits(found.compatibility, found.report) == list(found.notices)
    after = aerodb.replace_terms(aerodb.replace_terms(placed(), found), found)
    assert len(notices_of(after.attrs)) == 1  # once, however often
    aerodb.save(after, tmp_path / "final.nc")
    assert notices_of(aerodb.open(tmp_path / "final.nc").attrs) == list(found.notices)


@pytest.mark.slow
def test_fits_that_agree_against_a_table_name_the_table():
    """Two fits of one place with the same lift, ten times the a-priori error above the table."""
    fits = [fit(), fit(name="other")]
    for one in fits:
        one.estimates["estimate"].values[0] += 0.5
    with pytest.warns(AeromatchWarning, match="CL/basic moves by") as caught:
        found = tabulate(fits, placed())
    assert found.report["change_in_sd"]["CL/basic"] == pytest.approx(10.0, rel=0.1)
    assert "moves by 10 of its a-priori standard errors)" in str(caught[0].message)
    assert "of the fits grow" not in str(caught[0].message).split(")")[0]


def test_fits_that_agree_give_no_warning():
    assert tabulate([fit(), fit(name="again")], placed()).notices == ()
