"""Eigenmotions by fit: free and driven responses of known modes, and records in which there is
none.
"""

import numpy as np
import pytest
import xarray as xr
from scipy.signal import lfilter, lsim

from flightmech.errors import IdentificationError, SchemaError, UnknownName
from flighttest.remarks import is_forbidden
from flighttest.submodels.aircraft_properties import eigenmotion, mode_response
from flighttest.submodels.aircraft_properties.eigenmotion import fit_motion

SIGMA, OMEGA = 0.2, 2.0
ROOT = 2 * SIGMA, SIGMA**2 + OMEGA**2


def free(noise=0.0, seed=0, duration=12.0, rate=10.0):
    t = np.arange(round(duration * rate)) / rate
    decay = np.exp(-SIGMA * t)
    rng = np.random.default_rng(seed)
    columns = {
        "r": 0.3 + decay * np.cos(OMEGA * t + 1.0),
        "p": 0.1 * t + 2.0 * decay * np.cos(OMEGA * t - 0.4),
    }
    return xr.Dataset(
        {name: ("time", x + noise * rng.standard_normal(t.size)) for name, x in columns.items()},
        {"time": t},
    )


def driven(kind):
    """Pitch rate behind an elevator, or roll rate behind an aileron, with a trimmed control; linear
    between samples.
    """
    t = np.arange(0.0, 10.0, 0.05)
    u = 0.02 + 0.1 * (((t > 1.0) & (t < 2.5)) * 1.0 - 0.5 * ((t > 4.0) & (t < 6.0)))
    system = ([-5.0, -4.0], [1.0, *ROOT]) if kind == "oscillation" else ([-8.0], [1.0, 2.5])
    _, y, _ = lsim(system, u - u[0], t)
    return xr.Dataset({"rate": ("time", y + 0.05), "control": ("time", u)}, {"time": t})


@pytest.mark.nightly
def test_free_oscillation_to_rounding():
    found = fit_motion(free(), ["r", "p"])
    assert found.sigma == pytest.approx(SIGMA, rel=1e-6)
    assert found.omega == pytest.approx(OMEGA, rel=1e-6)
    values = {name: row[0] for name, row in found.values.items()}
    assert values["period"] == pytest.approx(np.pi, rel=1e-6)
    assert values["damping_ratio"] == pytest.approx(SIGMA / np.hypot(SIGMA, OMEGA), rel=1e-6)
    assert values["t_half"] == pytest.approx(np.log(2.0) / SIGMA, rel=1e-6)
    assert "period" in found.report()
    assert found.share == pytest.approx(1.0)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("kind", "roots"), [("oscillation", (SIGMA, OMEGA)), ("aperiodic", (2.5, 0.0))]
)
def test_driven_response_to_rounding(kind, roots):
    found = fit_motion(driven(kind), ["rate"], kind, ["control"], trend=False)
    assert (found.sigma, found.omega) == pytest.approx(roots, rel=1e-5)
    assert fit_motion(driven("aperiodic"), ["rate"], "aperiodic", ["control"]).values[
        "time_constant"
    ][0] == pytest.approx(0.4, rel=1e-5)


def test_growing_spiral():
    t = np.arange(0.0, 40.0, 0.2)
    found = fit_motion(
        xr.Dataset({"phi": ("time", 0.1 * np.exp(t / 30.0))}, {"time": t}),
        ["phi"],
        "aperiodic",
        trend=False,
    )
    assert found.values["time_constant"][0] == pytest.approx(-30.0, rel=1e-5)
    assert found.values["t_half"][0] == pytest.approx(-30.0 * np.log(2.0), rel=1e-5)  # to double


@pytest.mark.nightly
@pytest.mark.slow
def test_standard_errors_cover_the_truth():
    """25 noisy records, two channels: the errors in standard errors scatter by one (chi of 50
    values: 0.8 to 1.2 in 95 %).
    """
    errors = []
    for seed in range(25):
        found = fit_motion(free(0.05, seed), ["r", "p"])
        errors += [
            (found.sigma - SIGMA) / found.covariance[0, 0] ** 0.5,
            (found.omega - OMEGA) / found.covariance[1, 1] ** 0.5,
        ]
    assert 0.75 < np.sqrt(np.mean(np.square(errors))) < 1.3
    assert np.mean(np.abs(errors) < 2.0) > 0.87


def test_no_motion_is_refused_by_name():
    quiet = xr.Dataset(
        {"r": ("time", np.random.default_rng(1).standard_normal(200))},
        {"time": 0.1 * np.arange(200)},
    )
    with pytest.raises(
        IdentificationError, match=r"no oscillation stands out in r: it explains .* 50% are needed"
    ):
        fit_motion(quiet, ["r"])
    with pytest.raises(IdentificationError, match="no aperiodic motion stands out in r"):
        fit_motion(quiet, ["r"], "aperiodic")
    with pytest.raises(IdentificationError, match="no motion: r moves by 0 in the window"):
        fit_motion(quiet * 0.0, ["r"])
    still = driven("aperiodic").assign(control=("time", np.full(200, 0.1)))
    with pytest.raises(IdentificationError, match="no excitation: control moves by 0 "):
        fit_motion(still, ["rate"], "aperiodic", ["control"])


def test_bad_records_are_refused_by_name():
    data = free()
    gap = data.isel(time=np.r_[0:40, 60:120])
    with pytest.raises(SchemaError, match="time is not uniform"):
        fit_motion(gap, ["r"])
    with pytest.raises(SchemaError, match="p: samples are missing"):
        fit_motion(data.assign(p=data["p"].where(data["time"] > 1.0)), ["r", "p"])
    with pytest.raises(UnknownName, match="unknown channel 'rr'"):
        fit_motion(data, ["rr"])
    with pytest.raises(SchemaError, match="kind is 'spiral'; allowed: oscillation, aperiodic"):
        fit_motion(data, ["r"], "spiral")


@pytest.mark.nightly
def test_a_figure_of_the_window_is_refused():
    """A second mode at the begin of the window: the period is none of the motion, and 97 % are
    explained.
    """
    data = free(0.002, duration=8.0)
    slow = 1.5 * np.exp(-0.8 * data["time"]) * np.cos(0.9 * data["time"])
    found = fit_motion(data[["r"]] + slow, ["r"])
    assert found.share > 0.85
    assert abs(found.values["period"][0] / np.pi - 1.0) > 0.09
    (refusal,) = [remark for remark in found.remarks if remark.severity == "error"]
    assert refusal.kind == "window"
    assert "depends on the window: period" in refusal.text
    assert refusal.value > refusal.threshold
    later = fit_motion(
        (data[["r"]] + slow).sel(time=slice(5.0, None)), ["r"]
    )  # the second mode has died out
    assert later.values["period"][0] == pytest.approx(np.pi, rel=0.05)


@pytest.mark.nightly
def test_a_motion_that_is_alone_is_the_same_in_other_windows():
    for seed in range(5):
        found = fit_motion(free(0.05, seed), ["r", "p"])
        assert len(found.moved) == 6
        assert not is_forbidden(found.remarks)


@pytest.mark.nightly
def test_windows_of_a_driven_motion_hold_its_input():
    found = fit_motion(driven("oscillation"), ["rate"], "oscillation", ["control"], trend=False)
    assert {round(one.start, 1) for one in found.moved} <= {
        0.0,
        0.5,
        1.0,
    }  # the control begins to move at 1 s
    assert not is_forbidden(found.remarks)


def coloured(seed, tau, duration=12.0, step=0.1):
    """A channel that nothing excites: noise with one correlation time."""
    keep, rng, n = np.exp(-step / tau), np.random.default_rng(seed), round(duration / step)
    x = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.standard_normal(n + 500))[500:]
    return xr.Dataset({"r": ("time", x)}, {"time": step * np.arange(n)})


@pytest.mark.nightly
@pytest.mark.parametrize(
    "tau", [0.3, *(pytest.param(tau, marks=pytest.mark.slow) for tau in (1.0, 5.0))]
)
def test_a_quiet_stretch_gives_no_figure(tau):
    """Forty records of slow noise: refused, or remarked as an error; at most three pass (one in a
    thousand per free frequency).
    """
    passed = 0
    for seed in range(40):
        try:
            passed += not is_forbidden(fit_motion(coloured(seed, tau), ["r"]).remarks)
        except IdentificationError:
            continue
    assert passed <= 3


@pytest.mark.nightly
def test_a_slow_curve_is_no_oscillation():
    """Speed that drifts along random bends in a minute: a cycle explains up to 99 % of it, and a
    cubic as much; one of 25 passed.
    """
    passed, shares, t = 0, [], 0.1 * np.arange(600)
    for seed in range(25):
        drift = (
            100.0 + np.cumsum(np.cumsum(np.random.default_rng(seed).standard_normal(600))) / 1000.0
        )
        try:
            found = fit_motion(xr.Dataset({"V": ("time", drift)}, {"time": t}), ["V"])
        except IdentificationError:
            continue
        passed += not is_forbidden(found.remarks)
        shares.append(found.share)
    assert passed <= 2
    assert max(shares) > 0.99


@pytest.mark.nightly
@pytest.mark.slow
def test_an_excited_motion_carries_no_error():
    for seed in range(10):
        assert not is_forbidden(fit_motion(free(0.05, seed), ["r", "p"]).remarks)
    found = fit_motion(free(0.05), ["r", "p"])
    assert found.F_probability < 1e-6
    assert "amplitudes: F(4, " in found.report()
    for kind in ("oscillation", "aperiodic"):
        assert not is_forbidden(
            fit_motion(driven(kind), ["rate"], kind, ["control"], trend=False).remarks
        )


@pytest.mark.nightly
def test_a_motion_that_grows_or_has_no_known_decay_is_remarked():
    t = 0.1 * np.arange(120)
    grown = xr.Dataset({"r": ("time", np.exp(0.3 * t) * np.cos(2.0 * t))}, {"time": t})
    (remark,) = fit_motion(grown, ["r"]).remarks
    assert (remark.kind, remark.severity) == ("growth", "error")
    rng = np.random.default_rng(3)
    steady = xr.Dataset(
        {"r": ("time", np.cos(2.0 * t) + 0.1 * rng.standard_normal(120))}, {"time": t}
    )
    (remark,) = fit_motion(steady, ["r"]).remarks
    assert (remark.kind, remark.term, remark.severity) == ("not significant", "sigma", "warning")


def test_an_oscillation_that_no_shorter_window_can_confirm_is_remarked(monkeypatch):
    """Of a window that holds one period, a third cannot be left out."""
    monkeypatch.setattr(eigenmotion, "fits_in_moved_windows", lambda *_, **__: ())
    remarks = fit_motion(free(0.05), ["r", "p"]).remarks
    assert [(r.kind, r.severity) for r in remarks] == [("window", "warning")]
    assert remarks[0].text.startswith("not checked: no shorter window is long enough")


def test_reversed_time_is_refused():
    with pytest.raises(SchemaError, match="its time is not uniform or does not rise"):
        fit_motion(free().isel(time=slice(None, None, -1)), ["r"])


@pytest.mark.nightly
def test_a_search_that_stops_at_its_limit_is_an_error(monkeypatch):
    complete = fit_motion(free(0.05), ["r", "p"])
    assert complete.convergence.converged
    # A third round of weights moves the root by at most 0.1 standard errors (20 seeds).
    assert complete.convergence.change < 0.25
    assert "explained, converged" in complete.report()
    monkeypatch.setattr(mode_response, "_EVALUATIONS", 1)
    stopped = fit_motion(free(0.05), ["r", "p"])
    assert not stopped.convergence.converged
    assert is_forbidden(stopped.remarks)
    assert "NOT converged" in stopped.report()
    (remark,) = [remark for remark in stopped.remarks if remark.kind == "convergence"]
    assert "!! root of r p: not converged" in stopped.report()
    assert remark.value == np.inf


@pytest.mark.nightly
def test_weights_that_still_move_the_root_are_remarked(monkeypatch):
    """Both channels have the same noise, but not the same motion, from which the first weights
    come: a second round moves the root by 0.7 to 1.5 standard errors (five seeds).
    """
    monkeypatch.setattr(mode_response, "_ROUNDS", 1)
    stopped = fit_motion(free(0.05, 1), ["r", "p"])
    (remark,) = [remark for remark in stopped.remarks if remark.kind == "convergence"]
    assert remark.severity == "warning"
    assert remark.value == pytest.approx(1.431, abs=0.01)
    # A single channel has no weights that matter.
    assert fit_motion(free(0.05, 1), ["r"]).convergence.change == 0.0


@pytest.mark.nightly
def test_shorter_windows_that_did_not_converge_are_not_compared(monkeypatch):
    """With few evaluations in short windows only the whole window converges."""
    search = mode_response.ModeResponse.search_root

    def stopped_in_short_windows(model):
        limit = 1 if len(model.t) < 120 else 100
        monkeypatch.setattr(mode_response, "_EVALUATIONS", limit)
        return search(model)

    monkeypatch.setattr(mode_response.ModeResponse, "search_root", stopped_in_short_windows)
    found = fit_motion(free(0.05), ["r", "p"])
    assert found.convergence.converged
    assert (found.moved, found.unsettled) == ((), 6)
    (remark,) = [remark for remark in found.remarks if remark.kind == "window"]
    assert remark.severity == "warning"
    assert remark.text.startswith("6 of 6 shorter windows: the fit did not converge")
