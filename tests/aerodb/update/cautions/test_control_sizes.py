"""Controls whose effect in flight is one that no aerodynamics explains."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from aerodb.edit import replace_terms
from aerodb.store.schema import make_database
from aerodb.update.cautions.control_sizes import (
    control_sizes,
    doubted_control,
    doubtful_sizes,
    sizes_text,
)
from aerodb.update.cautions.notices import notices_of
from aerodb.update.tabulation import tabulate
from flightmech import terms
from flightmech.errors import AeromatchWarning

ROOT = dict(title="test", aircraft="test", S=16.0, cbar=1.6, b=10.0, x_ref=0.0, y_ref=0.0)
ROOT |= dict(z_ref=0.0, force_axes="stability")
TIME = np.arange(0.0, 12.0, 0.05)
MOTION = {
    "beta": 0.03 * np.sin(TIME),
    "phat": 0.05 * np.sin(1.7 * TIME),
    "delta_a": 0.08 * np.cos(3.1 * TIME),
}
TRUTH = {"1": 0.0, "beta": -0.08, "phat": -0.5, "delta_a": -0.2}


def leaf(value, regressors, stderr):
    return terms.make_term(value, {}, regressors, stderr=stderr, source="datcom")


def prior(aileron=-0.2, stderr=0.04):
    leaves = {
        "Cl/basic": leaf(0.0, [], 0.002),
        "Cl/beta": leaf(-0.08, ["beta"], 0.02),
        "Cl/phat": leaf(-0.5, ["phat"], 0.08),
        "Cl/aileron": leaf(aileron, ["delta_a"], stderr),
    }
    return make_database(leaves, **ROOT)


def fit(name, gain=1.0, noise=2e-4, seed=1):
    """Least squares of a roll whose ailerons are recorded with a gain."""
    recorded = {**MOTION, "delta_a": gain * MOTION["delta_a"]}
    columns = {"1": np.ones(TIME.size), **MOTION}
    z = sum(value * columns[key] for key, value in TRUTH.items())
    z = z + noise * np.random.default_rng(seed).normal(size=TIME.size)
    X = np.column_stack([np.ones(TIME.size), *recorded.values()])
    covariance = noise**2 * np.linalg.inv(X.T @ X)
    estimates = {
        "estimate": ("term", np.linalg.lstsq(X, z, rcond=None)[0]),
        "stderr": ("term", np.sqrt(np.diag(covariance))),
        "stderr_systematic": ("term", np.zeros(len(TRUTH))),
        "covariance": (("term", "term_"), covariance),
        "systematic": (("term", "error"), np.zeros((len(TRUTH), 0))),
    }
    attributes = {"coefficient": "Cl", "name": name}
    samples = {key: ("sample", value) for key, value in {**recorded, "Cl": z}.items()}
    return SimpleNamespace(
        name=name,
        estimates=xr.Dataset(
            estimates, {"term": list(TRUTH), "error": np.array([], str)}, attributes
        ),
        data=xr.Dataset(samples),
        design=xr.DataArray(X, dims=("sample", "term")),
    )


def fits(gain):
    return [fit("slow", gain), fit("fast", gain, seed=2)]


def test_half_the_gain_gives_twice_the_effect_and_the_damping_as_expected():
    sizes = control_sizes(fits(0.5), prior())
    row = sizes.loc["delta_a"]
    assert row["ratio"] == pytest.approx(2.0, abs=0.02)
    assert row["damping"] == pytest.approx(1.0, abs=0.02)
    assert (row["coefficient"], row["fits"]) == ("Cl", 2)
    text = doubtful_sizes(sizes)["delta_a"]
    assert text.startswith("size of delta_a: the flights give 2.00")
    assert "gain of the recorded delta_a is more likely wrong" in text
    assert doubted_control(text) == "delta_a"


@pytest.mark.parametrize("gain", [1.0, 0.85, 1.6])
def test_usual_effects_are_stated_only(gain):
    sizes = control_sizes(fits(gain), prior())
    assert doubtful_sizes(sizes) == {}
    assert sizes.loc["delta_a", "ratio"] == pytest.approx(1.0 / gain, abs=0.02)
    assert sizes_text(sizes).startswith(f"delta_a {sizes.loc['delta_a', 'ratio']:.2f} of its")


def test_an_effect_that_is_not_known_before_is_not_compared():
    """The rudder of a project whose listings have none: zero with a wide standard error."""
    for db in (prior(0.0, 0.15), prior(-0.1, 0.08)):
        sizes = control_sizes(fits(0.5), db)
        assert doubtful_sizes(sizes) == {}
        assert "delta_a has no known a-priori effect" in sizes_text(sizes)


def test_a_wide_prior_leaves_room_for_its_errors():
    """1.54 of a guess with 40 % of error is expected; 2.0 of one with 20 % is not."""
    sizes = control_sizes(fits(1.0), prior(-0.13, 0.052))
    assert sizes.loc["delta_a", "prior_stderr"] == pytest.approx(0.4, abs=1e-6)
    assert sizes.loc["delta_a", "ratio"] == pytest.approx(1.54, abs=0.02)
    assert doubtful_sizes(sizes) == {}
    assert list(doubtful_sizes(control_sizes(fits(1.0), prior(-0.1, 0.02)))) == ["delta_a"]


def test_the_doubt_is_a_warning_and_a_notice_of_the_database():
    db = prior()
    with pytest.warns(AeromatchWarning, match="size of delta_a"):
        found = tabulate(fits(0.5), db)
    (notice,) = (text for text in notices_of(replace_terms(db, found).attrs) if "size" in text)
    assert doubted_control(notice) == "delta_a"
    assert doubted_control("suspect fits: slow") == ""
