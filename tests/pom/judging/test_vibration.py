"""Predominant frequencies of a buffet: spectra with known peaks."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from pom.cases.case import PomCase
from pom.judging.measures.vibration import vibration_peaks
from pom.judging.verdict import judge_criterion
from pom.tolerances import rows
from pom.tolerances.bands import Invalid, remarks_text

TIME = np.arange(0.0, 30.0, 0.01)


def shaken(frequencies, seed=1, size=0.05):
    """Return a load factor with narrow-band vibration about frequencies [Hz]."""
    noise = np.random.default_rng(seed).normal(size=(len(frequencies), TIME.size))
    total = 1.0 + 0.002 * np.random.default_rng(seed + 1).normal(size=TIME.size)
    for frequency, drive in zip(frequencies, noise, strict=True):
        b, a = scipy.signal.iirpeak(frequency, 12.0, fs=100.0)
        total += size * scipy.signal.lfilter(b, a, drive)
    return total


def judged(flight, model, **more):
    (row,) = rows.rows_of_test("3.f.5")
    criterion = rows.make_criterion(row, "normal_acceleration", (0.0, 30.0))
    case = PomCase(
        "c", "c", "3.f.5", rows.STANDARD, rows.EDITION, "c.toml", "r.nc", (0.0, 30.0),
        criteria=(criterion,), **more,
    )  # fmt: skip
    return judge_criterion(case, criterion, TIME, {"nz": flight}, {"nz": model})


def test_peaks_of_narrow_bands_are_found():
    for seed in range(5):
        found = np.sort(vibration_peaks(TIME, shaken((4.0, 9.0, 15.0), 10 * seed))[:3])
        assert found == pytest.approx([4.0, 9.0, 15.0], abs=0.75)


def test_white_noise_has_hardly_a_peak():
    counts = []
    for seed in range(10):
        counts.append(vibration_peaks(TIME, shaken((), seed)).size)
    # fewer than the row needs
    assert max(counts) < 3


def test_three_peaks_within_two_hertz_wait_for_a_tick():
    flight = shaken((4.0, 9.0, 15.0, 22.0))
    right = judged(flight, shaken((5.0, 9.5, 14.0), seed=5))
    assert right.verdict == "advisory"
    assert abs(right.worst) <= 2.0
    assert (
        judged(
            flight, shaken((5.0, 9.5, 14.0), seed=5), ticks={"normal_acceleration": "J. Doe"}
        ).verdict
        == "pass"
    )
    wrong = judged(
        flight, shaken((6.8, 12.0, 18.5), seed=5), ticks={"normal_acceleration": "J. Doe"}
    )
    assert wrong.verdict == "fail"
    assert "a tick does not overrule the frequencies" in remarks_text(wrong.remarks)


def test_a_model_without_vibration_fails_and_a_calm_flight_is_invalid():
    flight, still = shaken((4.0, 9.0, 15.0)), np.ones(TIME.size)
    assert judged(flight, still).verdict == "fail"
    assert "the model has 0 of the three frequency peaks" in remarks_text(
        judged(flight, still).remarks
    )
    calm = judged(still, flight)
    assert calm.verdict == "invalid"
    assert "flight has 0 frequency peaks" in remarks_text(calm.remarks)
    with pytest.raises(Invalid, match="needs 9 s of vibration"):
        vibration_peaks(TIME[:800], flight[:800])


def test_two_peaks_within_two_hertz_are_not_three():
    tick = {"normal_acceleration": "J. Doe"}
    two = judged(shaken((4.0, 9.0, 15.0)), shaken((4.0, 9.0, 19.0), seed=5), ticks=tick)
    assert two.verdict == "fail"


def test_the_row_of_2016_has_no_number():
    (row,) = rows.rows_of_test("3.f.5", edition="2016-05-31 (Amdt 60-4)")
    criterion = rows.make_criterion(row, "normal_acceleration", (0.0, 30.0))
    assert criterion.reason == rows.NUMBER_NOT_READ
    assert replace(criterion, reason="").measure == "vibration"


def test_a_model_of_weak_peaks_or_of_a_single_one_fails():
    tick = {"normal_acceleration": "J. Doe"}
    weak = shaken((30.0, 36.0, 42.0), seed=3, size=0.005) - 1.0
    flight = shaken((4.0, 9.0, 15.0), size=0.1) + weak
    assert judged(flight, 1.0 + weak, ticks=tick).verdict == "fail"
    # one tone in the middle is within 2 Hz of all three
    close = 1.0 + sum(0.05 * np.sin(2.0 * np.pi * f * TIME) for f in (9.5, 11.5, 13.5))
    tone = 1.0 + 0.05 * np.sin(2.0 * np.pi * 11.5 * TIME)
    alone = judged(close, tone, ticks=tick)
    assert alone.verdict == "fail"
    assert "the model has 1 of the three" in remarks_text(alone.remarks)
