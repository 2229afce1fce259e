"""Joint covariance of the nodes of an identified database: stored, drawn from, followed through
edits.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import block_diag

import aerodb
from aerodb.edit.breakpoint_edits import regrid
from aerodb.edit.ground_effect import in_ground_effect
from aerodb.edit.table_edits import scale, shift
from aerodb.figures.lr743_set.combinations import combine_coefficients
from aerodb.store.schema import make_database
from aerodb.update.correlation import PARTS, prior_covariance, prior_parts
from aerodb.update.observations import basis_at
from aerodb.update.posterior import common_errors, covariance, draw, joint_mark, with_node_values
from aerodb.update.standard_errors import standard_error, standard_errors
from aerodb.update.tabulation import tabulate
from flightmech import terms
from flightmech.errors import SchemaError, UnknownName
from tests.aerodb.update.test_tabulation import DEG, ROOT, local_fits, prior_leaves
from tests.aerodb.update.test_tabulation import drawn as truth_of

RELATIVE_ROUNDING = (
    1e-12  # of the largest eigenvalue, a hundred at most: 1000 nodes in double precision
)
FLOWN = {"alpha": np.linspace(0, 7, 15) * DEG, "mach": 0.35, "qhat": 0.001, "delta_e": -0.02}


@pytest.fixture(scope="module")
def flown():
    """Prior, fits, their tabulation, and the database after them; Cm/basic is there without
    fits.
    """
    leaves = prior_leaves()
    leaves["Cm/basic"] = terms.make_term(
        [0.1, -0.1], {"alpha": [0.0, 0.2]}, stderr=[0.02, 0.03], source="datcom"
    )
    prior = make_database(leaves, **ROOT)
    rng = np.random.default_rng(3)
    fits = local_fits(
        truth_of({name: leaf for name, leaf in leaves.items() if name.startswith("CL/")}, rng), rng
    )
    found = tabulate(fits, prior)
    return prior, fits, found, aerodb.replace_terms(prior, found)


def basis(db, conditions, coefficient="CL"):
    leaves = [leaf for name, leaf in aerodb.terms(db).items() if name.startswith(f"{coefficient}/")]
    size = np.broadcast(*conditions.values()).size
    whole = {name: np.broadcast_to(x, size) for name, x in conditions.items()}
    return np.hstack([terms.basis(leaf, whole, "clamp").toarray() for leaf in leaves])


def test_stored_covariance_is_that_of_the_linear_gaussian_model(flown):
    """V = P - P H' (H P H' + C)^-1 H P, with the weights that the tabulation reports, built here
    from the fits themselves.
    """
    prior, fits, found, after = flown
    leaves = {name: leaf for name, leaf in aerodb.terms(prior).items() if name.startswith("CL/")}
    H, blocks = [], []
    for fit, weight in zip(fits, found.points["weight"], strict=True):
        X = fit.design.values
        H.append(
            np.linalg.pinv(X)
            @ np.hstack([basis_at(leaf, fit.data).toarray() for leaf in leaves.values()])
        )
        blocks.append(
            fit.estimates["covariance"].values
            * found.compatibility.loc["CL", "inflation"] ** 2
            / weight
        )
    P = []
    for name, leaf in leaves.items():
        sampled = np.max(
            [
                basis_at(terms.without_multipliers(leaf), fit.data).max(axis=0).toarray().ravel()
                for fit in fits
            ],
            axis=0,
        )
        P.append(
            np.einsum(
                "k,kij->ij",
                found.report.loc[name, list(PARTS)].astype(float),
                prior_parts(leaf, sampled),
            )
        )
    H, P = np.vstack(H), block_diag(*P)
    expected = P - P @ H.T @ np.linalg.solve(H @ P @ H.T + block_diag(*blocks), H @ P)
    slices, V = covariance(after, "CL")
    assert list(slices) == list(leaves)
    np.testing.assert_allclose(V, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


def test_its_diagonal_is_stderr(flown):
    slices, V = covariance(flown[3], "CL")
    leaves = aerodb.terms(flown[3])
    for name, rows in slices.items():
        np.testing.assert_allclose(
            np.sqrt(np.diag(V)[rows]), leaves[name]["stderr"].values.ravel(), rtol=1e-8
        )


def test_standard_error_of_a_coefficient_is_that_of_the_joint_covariance(flown):
    _, _, _, db = flown
    B, (_, V) = basis(db, FLOWN), covariance(db, "CL")
    joint = np.sqrt(np.einsum("ij,jk,ik->i", B, V, B))
    np.testing.assert_allclose(standard_error(db, "CL", FLOWN), joint, rtol=1e-6)
    independent = np.sqrt(B**2 @ np.diag(V))
    assert (
        joint[:8] < 0.8 * independent[:8]
    ).all()  # within the flights, 0 to 3.5 deg: sums are known better than nodes


def test_standard_error_of_a_derivative(flown):
    _, _, _, db = flown
    at = {**FLOWN, "alpha": np.array([1.0, 3.0, 5.0]) * DEG}  # between breakpoints
    h = 1e-3
    slope = (
        basis(db, {**at, "alpha": at["alpha"] + h}) - basis(db, {**at, "alpha": at["alpha"] - h})
    ) / (2 * h)
    expected = np.sqrt(np.einsum("ij,jk,ik->i", slope, covariance(db, "CL")[1], slope))
    np.testing.assert_allclose(
        standard_error(db, "CL", at, derivative="alpha"), expected, rtol=1e-5
    )
    np.testing.assert_array_equal(
        standard_error(db, "CL", {**at, "beta": 0.0}, derivative="beta"), 0.0
    )
    with pytest.raises(UnknownName, match="phat"):
        standard_error(db, "CL", at, derivative="phat")


def test_without_flight_the_a_priori_correlation_stays(flown):
    prior, _, _, after = flown
    np.testing.assert_allclose(
        covariance(after, "Cm")[1], prior_covariance(aerodb.terms(prior)["Cm/basic"])
    )
    np.testing.assert_allclose(
        standard_error(after, "Cm", {"alpha": 0.1}), standard_error(prior, "Cm", {"alpha": 0.1})
    )


def test_draws_have_the_covariance_and_repeat(flown):
    """4000 draws: a variance has a standard error of 2.2 %, so 10 % is 4.5 of them; 15
    conditions.
    """
    _, _, _, db = flown
    found = draw(db, 4000, seed=5)
    assert set(found) == {"CL/basic", "CL/qhat", "CL/elevator", "Cm/basic"}
    nodes = np.hstack(
        [found[name].reshape(4000, -1) for name in ("CL/basic", "CL/qhat", "CL/elevator")]
    )
    B = basis(db, FLOWN)
    np.testing.assert_allclose(
        (nodes @ B.T).std(axis=0), standard_error(db, "CL", FLOWN), rtol=0.05
    )
    value = np.concatenate(
        [
            aerodb.terms(db)[name]["value"].values.ravel()
            for name in ("CL/basic", "CL/qhat", "CL/elevator")
        ]
    )
    assert (
        np.abs((nodes @ B.T).mean(axis=0) - B @ value)
        < 4 * standard_error(db, "CL", FLOWN) / np.sqrt(4000)
    ).all()
    np.testing.assert_array_equal(
        draw(db, 3, seed=1, names=["Cm"])["Cm/basic"], draw(db, 3, seed=1)["Cm/basic"]
    )
    one = with_node_values(db, {name: values[0] for name, values in found.items()})
    np.testing.assert_array_equal(one["CL/basic"]["value"], found["CL/basic"][0])
    np.testing.assert_array_equal(
        db["CL/basic"]["value"], aerodb.terms(flown[3])["CL/basic"]["value"]
    )
    with pytest.raises(UnknownName, match="CX"):
        draw(db, 3, seed=1, names=["CX"])


@pytest.mark.slow
def test_draws_follow_the_errors_that_all_fits_share(flown):
    """A bias of 0.02 in the constant of every fit: what its number moves and the remainder are the
    covariance together.
    """
    prior, fits, _, _ = flown
    shared = np.zeros((len(fits[0].estimates["term"]), 1))
    shared[0] = 0.02
    biased = []
    for fit in fits:
        estimates = (
            fit.estimates.drop_dims("error")
            .assign(systematic=(("term", "error"), shared))
            .assign_coords(error=["bias"])
        )
        biased.append(SimpleNamespace(estimates=estimates, data=fit.data, design=fit.design))
    db = aerodb.replace_terms(prior, tabulate(biased, prior))
    assert common_errors(db) == ["bias"]
    slices, _ = covariance(db, "CL")
    moved, still = (draw(db, 3000, 5, ["CL"], {"bias": np.full(3000, size)}) for size in (1.0, 0.0))
    z, left = (
        np.hstack([(one[name] - sign * still[name]).reshape(3000, -1) for name in slices])
        for one, sign in ((moved, 1), (still, 0))
    )
    assert np.allclose(z, z[0], atol=1e-12)  # the same in every draw
    B = basis(db, FLOWN)
    assert 0.015 < (B @ z[0]).mean() < 0.025
    np.testing.assert_allclose(
        np.sqrt((left @ B.T).var(axis=0) + (B @ z[0]) ** 2),
        standard_error(db, "CL", FLOWN),
        rtol=0.05,
    )
    assert np.median((left @ B.T).std(axis=0)) < 0.3 * np.median(standard_error(db, "CL", FLOWN))
    for name, values in draw(db, 3, 5, ["CL"], {"other": np.ones(3)}).items():
        np.testing.assert_array_equal(values, draw(db, 3, 5, ["CL"])[name])


def test_file_keeps_it(flown, tmp_path):
    aerodb.save(flown[3], tmp_path / "final.nc")
    again = aerodb.open(tmp_path / "final.nc")
    np.testing.assert_array_equal(covariance(again, "CL")[1], covariance(flown[3], "CL")[1])


def test_factors_and_shifts_are_followed(flown):
    _, _, _, db = flown
    before, at = standard_error(db, "CL", FLOWN), FLOWN
    both = scale(db, "CL/*", 1.1)
    np.testing.assert_allclose(standard_error(both, "CL", at), 1.1 * before, rtol=1e-9)
    np.testing.assert_allclose(
        standard_error(shift(db, "CL/basic", 0.02), "CL", at), before, rtol=1e-9
    )
    wider = shift(
        db, "CL/basic", 0.02, stderr=0.05
    )  # of each node by itself: interpolation averages it
    assert (standard_error(wider, "CL", at) > np.hypot(before, 0.05 / 2)).all()
    assert (standard_error(wider, "CL", at) < np.hypot(before, 0.05)).all()
    leaf = aerodb.terms(db)["CL/qhat"]
    ground = in_ground_effect(leaf, 0.5, -1.0, floor=1.0)
    assert joint_mark(ground) == joint_mark(leaf)
    np.testing.assert_allclose(
        standard_errors(terms.basis(terms.without_multipliers(ground), {"mach": 0.3}), ground),
        0.5 * leaf["stderr"].sel(mach=0.3),
    )


def test_other_breakpoints_fall_back_to_the_a_priori_correlation(flown):
    db = regrid(flown[3], "CL/qhat", {"mach": [0.15, 0.45]})
    assert joint_mark(aerodb.terms(db)["CL/qhat"]) is None
    assert joint_mark(aerodb.terms(db)["CL/basic"]) is not None
    assert aerodb.check(db) == []


def test_terms_of_different_origin_are_independent(flown):
    prior, fits, _, db = flown
    other = tabulate(fits[:3], prior)
    mixed = aerodb.replace_terms(db, {"CL/elevator": other["CL/elevator"]})
    slices, V = covariance(mixed, "CL")
    assert np.all(V[slices["CL/elevator"], slices["CL/basic"]] == 0.0)
    assert np.any(V[slices["CL/qhat"], slices["CL/basic"]] != 0.0)


def test_faults_are_reported(flown):
    leaf = aerodb.terms(flown[3])["CL/qhat"]
    assert "no posterior_sign" in terms.check_term(leaf.drop_vars("posterior_sign"))[0]
    assert "stderr" in terms.check_term(leaf.drop_vars("stderr"))[0]
    assert "NaN" in terms.check_term(leaf.assign(posterior_sign=leaf["posterior_sign"] * np.nan))[0]
    assert (
        "origin"
        in terms.check_term(leaf.assign(posterior_factor=leaf["posterior_factor"].drop_attrs()))[0]
    )
    broken = leaf.assign(prior_error=leaf["prior_error"].drop_attrs())
    with pytest.raises(SchemaError, match="level"):
        standard_errors(terms.basis(broken, {"mach": 0.3, "qhat": 0.001}), broken)


@pytest.mark.slow
# by chance, one of the 30 simulated sets each
@pytest.mark.filterwarnings("ignore:incompatible fits")
@pytest.mark.filterwarnings("ignore:suspect fits")
@pytest.mark.nightly
def test_two_standard_errors_cover_the_coefficient():
    """Along the flown incidences, 30 truths: 15 conditions of one truth are strongly correlated, so
    88 to 99 % are allowed.
    """
    leaves, z = prior_leaves(), []
    prior = make_database(leaves, **ROOT)
    for seed in range(100, 130):
        rng = np.random.default_rng(seed)
        truth = truth_of(leaves, rng)
        after = aerodb.replace_terms(prior, tabulate(local_fits(truth, rng), prior))
        error = sum(
            terms.evaluate_term(aerodb.terms(after)[name], FLOWN) - terms.evaluate_term(leaf, FLOWN)
            for name, leaf in truth.items()
        )
        z.append(error / standard_error(after, "CL", FLOWN))
    assert 0.88 < np.mean(np.abs(z) < 2) < 0.99
    assert 0.7 < np.sqrt(np.mean(np.square(z))) < 1.3


def test_a_difference_of_conditions_has_the_joint_covariance_of_all_terms(flown):
    """Increments and chords, as the figures of LR-743 show them."""
    _, _, _, db = flown
    after, before = ({**FLOWN, "alpha": FLOWN["alpha"] + step} for step in (2.0 * DEG, 0.0))
    value, stderr = combine_coefficients(db, "CL", (0.5, after), (-0.5, before))
    B, (_, V) = 0.5 * (basis(db, after) - basis(db, before)), covariance(db, "CL")
    nodes = np.concatenate(
        [
            leaf["value"].values.ravel()
            for name, leaf in aerodb.terms(db).items()
            if name.startswith("CL/")
        ]
    )
    np.testing.assert_allclose(value, B @ nodes)
    np.testing.assert_allclose(stderr, np.sqrt(np.einsum("ij,jk,ik->i", B, V, B)), rtol=1e-6)


def least_eigenvalues(db):
    """Return the least eigenvalue over the largest of the correlation of the nodes, by
    coefficient.
    """
    found = {}
    for coefficient in dict.fromkeys(name.split("/")[0] for name in aerodb.terms(db)):
        _, V = covariance(db, coefficient)
        assert (np.diag(V) >= 0.0).all()
        sd = np.sqrt(np.diag(V))
        free = sd > 0.0
        if free.any():
            R = V[np.ix_(free, free)] / np.outer(sd[free], sd[free])
            np.testing.assert_allclose(R, R.T, rtol=0.0, atol=RELATIVE_ROUNDING)
            values = np.linalg.eigvalsh(R)
            found[coefficient] = values[0] / values[-1]
    return found


@pytest.mark.nightly
@pytest.mark.slow
def test_every_covariance_of_the_demo_is_positive_semidefinite(whole_demo):
    """Terms of the drag near the ground have standard errors and no posterior of their own; they
    stand next to terms that have.
    """
    db = aerodb.open(whole_demo[0] / "final.nc")
    leaves = aerodb.terms(db)
    assert "stderr" in leaves["CD/ground_basic"]
    assert joint_mark(leaves["CD/ground_basic"]) is None
    assert joint_mark(leaves["CD/basic"])
    found = least_eigenvalues(db)
    assert {"CL", "CD", "Cm", "CY", "Cl", "Cn", "Ch_e"} <= set(found)
    assert min(found.values()) > -RELATIVE_ROUNDING
    assert all(np.isfinite(values).all() for values in draw(db, 2, 1).values())
