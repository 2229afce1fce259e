"""What a fit states about itself: tests at their nominal rate on noise, signs, spikes, collinear
terms, reversed time.
"""

import numpy as np
import pytest
import xarray as xr
from flown_lift import LIFT, STEP, TRUTH, coloured_noise, record
from scipy import stats

from flightmech.errors import IdentificationError
from flighttest.regression.combining.mixed_estimation import mix_with_prior
from flighttest.regression.equation_error.fit_file import open_fit, save_fit
from flighttest.regression.equation_error.frequency.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.regression.model_structure.search import select_orthogonal
from flighttest.regression.uncertainty.significance import degrees_of_freedom, residual_whiteness
from flighttest.remarks import Remark, is_forbidden


def noise_only(seed, duration=20.0, tau=0.3):
    """Controls that move, and a coefficient that is nothing but a disturbance (white when tau is
    0).
    """
    rng = np.random.default_rng(seed)
    data = record(rng, duration, noise=0.0)
    n = data.sizes["time"]
    return data.assign(
        CL=("time", 0.01 * (coloured_noise(rng, n, tau) if tau else rng.normal(size=n)))
    )


def kinds(fit):
    return [remark.kind for remark in fit.remarks]


@pytest.mark.nightly
@pytest.mark.parametrize("tau", [0.0, pytest.param(0.3, marks=pytest.mark.slow)])
def test_noise_is_called_no_excitation(tau):
    """Sixty records each: F below 1 % in 0 to 0.7 % of 300 records of ten and thirty seconds; four
    of sixty are beyond chance.
    """
    fits = [regress(LIFT, noise_only(seed, tau=tau)) for seed in range(60)]
    passed = [fit for fit in fits if "no excitation" not in kinds(fit)]
    assert len(passed) <= 4
    assert all(is_forbidden(fit.remarks) for fit in fits if fit not in passed)
    p = np.concatenate([fit.estimates["p_value"].values[1:] for fit in fits])
    assert (
        0.02 < np.mean(p < 0.05) < 0.09
    )  # 2.7 to 4.7 % measured in 300 records of ten and thirty seconds


@pytest.mark.nightly
def test_noise_is_no_excitation_in_frequency_too():
    """Sixty records of seventeen frequencies."""
    passed = [
        seed
        for seed in range(60)
        if "no excitation" not in kinds(regress_frequency(LIFT, noise_only(seed), (0.05, 0.9)))
    ]
    assert len(passed) <= 4


@pytest.mark.nightly
def test_a_good_record_carries_no_remark_and_its_intervals_cover_the_truth():
    """Forty records of twenty seconds: 95 % of 160 estimates, give or take 3.4 % of one sigma of
    dependent ones.
    """
    inside = []
    for seed in range(40):
        fit = regress(LIFT, record(np.random.default_rng(seed), 20.0, 0.003))
        assert not is_forbidden(fit.remarks)
        truth = np.array(list(TRUTH.values()))
        inside.append(
            (fit.estimates["low"].values < truth) & (truth < fit.estimates["high"].values)
        )
    assert 0.9 < np.mean(inside) <= 0.99
    e = fit.estimates
    half = 0.5 * (e["high"] - e["low"]).values / e["stderr"].values
    np.testing.assert_allclose(
        half, stats.t.ppf(0.975, e["dof"].values), rtol=1e-9
    )  # no systematic errors here


def test_systematic_errors_widen_the_interval_and_leave_the_test_alone():
    data = record(np.random.default_rng(1), 20.0)
    change = np.stack([0.02 * data["CL"].values])
    plain = regress(LIFT, data).estimates
    wide = regress(
        LIFT, data.assign_coords(error=["qbar"]).assign(CL_error=(("error", "time"), change))
    ).estimates
    np.testing.assert_array_equal(plain["t"], wide["t"])
    assert ((wide["high"] - wide["low"]) > (plain["high"] - plain["low"])).all()


def test_a_systematic_error_larger_than_its_estimate_is_remarked():
    data = record(np.random.default_rng(1), 20.0).assign_coords(error=["mass"])
    for share, count in ((0.5, 0), (5.0, 3)):
        change = np.stack([share * data["CL"].values])
        fit = regress(LIFT, data.assign(CL_error=(("error", "time"), change)))
        found = [remark for remark in fit.remarks if remark.kind == "systematic"]
        # t and F contain no systematic error, and still pass
        assert len(found) == count
        assert fit.estimates.attrs["F_probability"] < 0.01
    assert "mostly by mass" in found[0].text


@pytest.mark.nightly
def test_a_term_that_does_nothing_is_not_significant():
    """qhat takes no part: at five per cent it is remarked in nearly all of twenty records, the
    others in none.
    """
    found = []
    for seed in range(20):
        data = record(np.random.default_rng(seed), 20.0, 0.003)
        data["CL"] = data["CL"] - TRUTH["qhat"] * data["qhat"]
        found.append(
            [
                remark.term
                for remark in regress(LIFT, data).remarks
                if remark.kind == "not significant"
            ]
        )
    assert sum(terms == ["qhat"] for terms in found) >= 16
    assert sum(bool(terms) for terms in found) == sum("qhat" in terms for terms in found)


def test_a_control_of_the_wrong_sign_is_remarked_by_the_convention():
    data = record(np.random.default_rng(2), 20.0, 0.002)
    (remark,) = [
        one
        for one in regress(LIFT, data.assign(delta_e=-data["delta_e"])).remarks
        if one.kind == "sign"
    ]
    assert (remark.term, remark.severity) == ("delta_e", "error")
    assert remark.value < remark.threshold < -2.0
    assert remark.text.startswith("sign against the convention: dCL/ddelta_e is -0.5")
    assert "positive by the definition of delta_e" in remark.text
    assert regress(LIFT, data).remarks == []
    curved = RegressionModel.parse(
        "CL = 1 + alpha + qhat + delta_e + alpha*delta_e"
    )  # the slope at the mean of the samples counts, not one term
    assert "sign" not in kinds(regress(curved, data))
    assert "sign" in kinds(regress(curved, data.assign(delta_e=-data["delta_e"])))


def test_a_sign_against_the_prior_is_remarked():
    fit = regress(LIFT, record(np.random.default_rng(2), 20.0, 0.002))
    (remark,) = [
        one for one in mix_with_prior(fit, {"alpha": (-4.0, 0.5)}).remarks if one.kind == "sign"
    ]
    assert (remark.term, remark.severity) == ("alpha", "error")
    assert "sign" not in [
        one.kind for one in mix_with_prior(fit, {"alpha": (-4.0, 5.0)}).remarks
    ]  # a prior that does not know its sign
    assert "sign" not in [one.kind for one in mix_with_prior(fit, {"alpha": (4.0, 0.5)}).remarks]


def test_little_explained_is_remarked():
    fit = regress(LIFT, record(np.random.default_rng(3), 30.0, 0.2, tau=0.1))
    (remark,) = [one for one in fit.remarks if one.kind == "unexplained"]
    assert remark.value == pytest.approx(fit.estimates.attrs["R2"])
    assert remark.threshold == 0.5


def test_one_spike_is_named_with_what_it_does():
    data = record(np.random.default_rng(4), 20.0)
    clean = regress(LIFT, data)
    spoilt = data.copy(deep=True)
    at = int(np.argmax(data["alpha"].values))
    spoilt["CL"][at] += 30.0
    fit = regress(LIFT, spoilt)
    (remark,) = [one for one in fit.remarks if one.kind == "spike"]
    assert f"in CL at {at * STEP:g} s" in remark.text
    assert "without it" in remark.text
    assert "weights='robust'" in remark.text
    assert remark.value > remark.threshold
    assert "spike" not in kinds(clean)
    robust = regress(LIFT, spoilt, weights="robust")
    assert "spike" not in kinds(robust)
    far = (
        np.abs(robust.estimates["estimate"] - clean.estimates["estimate"])
        / clean.estimates["stderr"]
    )
    assert float(far.max()) < 1.0


@pytest.mark.nightly
@pytest.mark.parametrize("tau", [0.0, 0.3, 1.0])
def test_noise_has_no_spikes(tau):
    """Twenty records of a thousand samples each; eight robust sigma of Gaussian noise are never
    reached.
    """
    assert not any("spike" in kinds(regress(LIFT, noise_only(seed, tau=tau))) for seed in range(20))


def test_time_that_runs_backwards_is_refused():
    data = record(np.random.default_rng(5), 20.0)
    reversed_record = data.isel(time=slice(None, None, -1))
    for fit in (
        lambda d: regress(LIFT, d),
        lambda d: regress_frequency(LIFT, d, (0.05, 1.0)),
        lambda d: select_orthogonal("CL", ["1", "alpha"], d),
    ):
        with pytest.raises(
            IdentificationError,
            match=r"time of manoeuvre 0 does not rise: .*all of its 1000 samples, from 19.98 to "
            r"0 s",
        ):
            fit(reversed_record)
    time = data["time"].values.copy()
    time[500] = time[499]
    with pytest.raises(
        IdentificationError,
        match=r"time of manoeuvre 1 does not rise: .* from 9.98 to 9.98 s at sample 500",
    ):
        regress(LIFT, [data, data.assign_coords(time=time)])


def test_terms_that_no_instrument_distinguishes_are_refused_by_name():
    data = record(np.random.default_rng(6), 20.0)
    rng = np.random.default_rng(0)
    counterpart = data["alpha"] * 0.01 + 1e-8 * rng.normal(size=data.sizes["time"])
    with pytest.raises(
        IdentificationError,
        match=r"cannot distinguish (alpha|qhat) \(.*e\+.*\), (alpha|qhat) .* limit of 1e\+06",
    ):
        regress(LIFT, data.assign(qhat=counterpart))
    near = regress(
        LIFT, data.assign(qhat=data["alpha"] * 0.01 + 2e-5 * rng.normal(size=data.sizes["time"]))
    )
    assert "collinear" in kinds(near)


def test_gaps_and_few_samples_leave_the_tests_finite():
    data = record(np.random.default_rng(7), 20.0)
    data["CL"][100:130] = np.nan
    data["CL"][600:640] = np.nan
    e = regress(LIFT, data).estimates
    assert np.isfinite(
        [
            e.attrs[name]
            for name in ("F", "F_dof", "F_probability", "portmanteau", "correlation_time")
        ]
    ).all()
    assert (e["dof"].values >= 1.0).all()


def test_only_a_constant_has_no_f_test():
    data = record(np.random.default_rng(8), 10.0)
    fit = regress(RegressionModel.parse("CL = 1"), data)
    assert fit.estimates.attrs["F_terms"] == 0
    assert kinds(fit) == []
    assert "all slopes" not in fit.report()


def test_whiteness_against_the_definition():
    rng = np.random.default_rng(9)
    v = coloured_noise(rng, 1000)
    found = residual_whiteness(v, [slice(0, 600), slice(600, 1000)], [STEP, STEP])
    parts = [v[:600] - v[:600].mean(), v[600:] - v[600:].mean()]
    power = sum(x @ x for x in parts)
    rho = [sum(x[: len(x) - k] @ x[k:] for x in parts) / power for k in range(21)]
    assert found["portmanteau"] == pytest.approx(
        1000 * 1002 * sum(rho[k] ** 2 / (1000 - k) for k in range(1, 21)), rel=1e-9
    )
    assert found["correlation_time"] == pytest.approx(0.3, abs=0.15)
    assert found["portmanteau_probability"] < 1e-10
    levels = [
        residual_whiteness(rng.normal(size=500), [slice(0, 500)], [STEP])["portmanteau_probability"]
        for _ in range(200)
    ]
    assert np.mean(np.array(levels) < 0.05) < 0.1


def test_degrees_of_freedom_are_those_of_the_frequencies_that_count():
    """An estimate that looks at one frequency has two; one that looks at m of equal weight has
    2 m.
    """
    rng = np.random.default_rng(10)
    t = np.arange(2000)
    for m in (1, 10, 40):
        A = sum(np.cos(2 * np.pi * (5 + k) * t / 2000 + rng.uniform(0, 6)) for k in range(m))[None]
        found = [
            degrees_of_freedom(A, rng.normal(size=2000), [slice(0, 2000)], 0)[0] for _ in range(200)
        ]
        expected = (
            2 * m if m > 1 else 4
        )  # a single ordinate is itself all there is: the moments give 4 for it
        assert np.median(found) == pytest.approx(expected, rel=0.25)


@pytest.mark.nightly
def test_report_file_and_document(tmp_path):
    fit = regress(LIFT, noise_only(0))
    text = fit.report()
    assert "95 % interval" in text
    assert "all slopes: F(3, " in text
    assert "residual: not white, portmanteau" in text
    assert "!! no excitation: " in text
    assert "correlation  " not in text
    assert "correlation  " in fit.report(correlation=True)
    save_fit(fit, tmp_path / "fit.nc")
    assert open_fit(tmp_path / "fit.nc").report() == text
    (remark,) = fit.remarks
    assert remark.as_dict()["kind"] == "no excitation"
    assert remark.as_dict()["threshold"] == 0.01
    with pytest.raises(ValueError, match="severity is 'bad'; allowed: error, warning, note"):
        Remark("x", "y", severity="bad")
    assert isinstance(fit.data, xr.Dataset)
