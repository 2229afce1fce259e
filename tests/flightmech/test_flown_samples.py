"""Samples kept with a model: copies of a flight are known under any name, other flights are not."""

import numpy as np
import pytest
from scipy.signal import lfilter

from flightmech.flown_samples import (
    FLOWN_SAMPLES,
    cut_windows,
    find_shared_windows,
    pack_windows,
    unpack_windows,
    with_flown_samples,
)

RATE = 50.0  # [Hz]
NOISE = 0.02


def flight(seed, length=30.0):
    """Return time and channels of a flight in turbulence, with noise."""
    generator = np.random.default_rng(seed)
    time = np.arange(0.0, length, 1.0 / RATE)
    channels = {}
    for name in ("p", "q", "r", "nz"):
        # a damped oscillation of 0.5 Hz that turbulence drives
        pole = np.exp((-0.6 + 3.1j) / RATE)
        motion = lfilter([1.0], np.poly([pole, pole.conj()]).real, generator.normal(size=time.size))
        channels[name] = motion / motion.std() + NOISE * generator.normal(size=time.size)
    return time, channels


TIME, CHANNELS = flight(1)
KEPT = unpack_windows(pack_windows(cut_windows("run_1: pitch", TIME, CHANNELS)))


def changed(make_time, rename=lambda channels: channels):
    """Return the flight on another clock, and its channels changed."""
    time = make_time(TIME)
    again = {name: np.interp(time, TIME, values) for name, values in CHANNELS.items()}
    return time, rename(again)


def with_noise(channels):
    generator = np.random.default_rng(9)
    return {name: item + 0.05 * generator.normal(size=item.size) for name, item in channels.items()}


COPIES = {
    "exact": changed(lambda time: time),
    "trimmed": changed(lambda time: time[333:700]),
    "thinned": changed(lambda time: time[::5]),
    "another clock": changed(lambda time: np.arange(3.013, 25.0, 0.027)),
    "shorter channels": changed(lambda time: time, lambda c: {n: c[n] for n in ("p", "q", "r")}),
    "mirrored": changed(lambda time: time, lambda c: {**c, "p": -c["p"], "r": -c["r"]}),
    "scaled and biased": changed(
        lambda time: time, lambda c: {n: 1.2 * v + 0.3 for n, v in c.items()}
    ),
    "with noise": changed(lambda time: time, with_noise),
}


@pytest.mark.parametrize("name", COPIES)
def test_copies_are_found(name):
    time, channels = COPIES[name]
    (shared,) = find_shared_windows(KEPT, time + 100.0, channels)
    assert shared.source == "run_1: pitch"
    assert shared.start == pytest.approx(100.0 + time[0], abs=0.2)
    assert shared.stop == pytest.approx(100.0 + time[-1], abs=0.5)


@pytest.mark.parametrize("seed", range(2, 22))
def test_other_flights_are_not(seed):
    assert find_shared_windows(KEPT, *flight(seed)) == []


def test_two_oscillations_flown_alike_are_not_one_flight():
    # the same Dutch roll twice: only noise and a little turbulence differ
    time, noise = np.arange(0.0, 12.0, 1.0 / RATE), np.random.default_rng(3)
    wave = np.exp(-0.2 * time) * np.sin(2.5 * time)

    def fly():
        return {
            name: size * wave + 0.02 * lfilter([0.1], [1, -0.9], noise.normal(size=time.size))
            for name, size in {"p": 1.0, "q": 0.05, "r": 0.6, "nz": 0.03}.items()
        }

    kept = unpack_windows(pack_windows(cut_windows("dutch", time, fly())))
    assert find_shared_windows(kept, time, fly()) == []


def test_windows_are_split_at_gaps_and_kept_once():
    time = np.concatenate([TIME[:500], TIME[700:]])
    channels = {name: np.delete(item, np.s_[500:700]) for name, item in CHANNELS.items()}
    windows = cut_windows("a", time, channels)
    assert [window.start for window in windows] == [TIME[0], TIME[700]]
    # fits of several coefficients have the same samples
    twice = pack_windows([*windows, *cut_windows("b", time, channels)])
    assert len(unpack_windows(twice)) == 2


def test_the_text_is_small_and_holds_the_means():
    (window,) = cut_windows("a", TIME, CHANNELS)
    text = pack_windows([window])
    (again,) = unpack_windows(text)
    assert len(text) < 60 * TIME[-1]
    change = np.median(np.abs(np.diff(window.means, axis=1)), axis=1)
    assert (np.abs(again.means - window.means).max(axis=1) <= 0.051 * change).all()


def test_a_damaged_text_holds_nothing():
    text = pack_windows(cut_windows("a", TIME, CHANNELS))
    assert unpack_windows("") == unpack_windows(text[:-9]) == unpack_windows("no text") == ()


def test_joined_databases_keep_the_samples_of_both():
    one = {FLOWN_SAMPLES: pack_windows(cut_windows("a", TIME, CHANNELS))}
    other = {FLOWN_SAMPLES: pack_windows(cut_windows("b", *flight(2)))}
    assert with_flown_samples({}, {}) == {}
    assert with_flown_samples(one, {}) == with_flown_samples(one, one) == one
    joined = unpack_windows(with_flown_samples(one, other)[FLOWN_SAMPLES])
    assert [window.source for window in joined] == ["a", "b"]


def pitch_manoeuvre(seed):
    """Return time and channels of a pitch doublet: roll and yaw hold noise alone."""
    generator = np.random.default_rng(seed)
    time = np.arange(0.0, 14.0, 1.0 / RATE)
    doublet = np.sign(np.sin(2.0 * time)) * (time < 6.0)
    response = lfilter([0.02], [1.0, -0.98], doublet)
    channels = {name: NOISE * generator.normal(size=time.size) for name in ("p", "r")}
    for name in ("q", "nz"):
        channels[name] = response + NOISE * generator.normal(size=time.size)
    return time, channels


def test_a_copy_of_a_pitch_manoeuvre_on_another_clock_is_known_by_its_noise():
    time, channels = pitch_manoeuvre(1)
    kept = unpack_windows(pack_windows(cut_windows("run_2: pitch", time, channels)))
    late = np.arange(1.013, 12.0, 0.02)
    copy = {name: np.interp(late, time, item) for name, item in channels.items()}
    (shared,) = find_shared_windows(kept, late + 50.0, copy)
    assert shared.correlation > 0.95
    # the same manoeuvre, flown again
    assert find_shared_windows(kept, *pitch_manoeuvre(2)) == []
