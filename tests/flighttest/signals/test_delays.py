import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from flightmech.errors import IdentificationError
from flighttest.records.signals.delays import time_delay
from flighttest.records.signals.resampling import remove_delay

STEP, FINE = 0.02, 10  # s; samples of the underlying signal per step


def pair(seed, count, band, noise, tau=None):
    """A band-limited random signal and its delayed, doubled copy, both with noise; the delay is
    drawn when not given.
    """
    rng = np.random.default_rng(seed)
    clock = np.arange(FINE * count + 10_000) * STEP / FINE
    signal = sosfiltfilt(butter(2, band, fs=FINE / STEP, output="sos"), rng.normal(size=len(clock)))
    signal /= signal.std()
    tau = rng.uniform(-0.2, 0.2) if tau is None else tau
    t = 5.0 + np.arange(count) * STEP
    x, y = np.interp(t, clock, signal), 2.0 * np.interp(t - tau, clock, signal)
    return x + noise[0] * rng.normal(size=count), y + 2.0 * noise[1] * rng.normal(size=count), tau


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("count", "band", "noise"),
    [
        (600, 1.5, (0.05, 0.1)),
        *(
            pytest.param(3000, *more, marks=pytest.mark.slow)
            for more in [(1.5, (0.05, 0.1)), (1.0, (0.3, 0.3))]
        ),
    ],
)
def test_standard_error_covers(count, band, noise):
    ratios = []
    for seed in range(200):
        x, y, tau = pair(seed, count, band, noise)
        found = time_delay(x, y, STEP)
        ratios.append((found.estimate - tau) / found.stderr)
    # 200 draws at 95 %: two binomial standard errors are 3 %; short records are one point short of
    # that
    assert 0.91 <= np.mean(np.abs(ratios) < 2.0) <= 0.985
    assert abs(np.mean(ratios)) < 0.25


def test_opposite_sign_is_reported_and_does_not_disturb():
    x, y, tau = pair(1, 3000, 1.5, (0.02, 0.02), tau=0.073)
    found = time_delay(x, -y, STEP)
    assert found.estimate == pytest.approx(tau, abs=4 * found.stderr)
    assert found.correlation < -0.98
    assert found.report().startswith("+7")


def test_removed_delay_leaves_none():
    x, y, tau = pair(2, 3000, 1.5, (0.01, 0.01), tau=0.12)
    time = np.arange(len(x)) * STEP
    left = time_delay(x[:-20], remove_delay(time, y, tau, "theta")[:-20], STEP)
    assert abs(left.estimate) < 4.0 * left.stderr + 1e-4  # a tenth of a millisecond for the spline


def test_removed_delay_keeps_what_is_missing():
    time = np.arange(20) * STEP
    x = 3.0 * time
    x[8] = np.nan
    moved = remove_delay(time, x, 1.5 * STEP, "theta")
    assert np.flatnonzero(np.isnan(moved)).tolist() == [
        6,
        7,
    ]  # what would come from next to sample 8
    np.testing.assert_allclose(moved[:6], 3.0 * (time[:6] + 1.5 * STEP), atol=1e-12)


def test_channels_that_share_nothing():
    rng = np.random.default_rng(3)
    with pytest.raises(IdentificationError, match="agree at no frequency"):
        time_delay(rng.normal(size=2000), rng.normal(size=2000), STEP)


def test_channel_that_does_not_move():
    with pytest.raises(IdentificationError, match="does not move"):
        time_delay(np.sin(np.arange(500)), np.zeros(500), STEP)


def test_too_short():
    with pytest.raises(IdentificationError, match="100 and 100 samples"):
        time_delay(np.zeros(100), np.zeros(100), STEP)


@pytest.mark.parametrize("tau", [0.6, -0.6])
def test_a_delay_beyond_the_search_is_a_bound(tau):
    x, y, _ = pair(3, 1000, 1.0, (0.02, 0.02), tau=tau)
    found = time_delay(x, y, STEP, longest=0.56)
    assert found.bound
    assert found.estimate == pytest.approx(np.copysign(0.56, tau))
    assert np.isinf(found.stderr)
    assert found.report().startswith(f"at least {'+' if tau > 0 else '-'}560.0 ms, correlation")
    wide = time_delay(x, y, STEP)
    assert not wide.bound
    assert wide.estimate == pytest.approx(tau, abs=0.01)
