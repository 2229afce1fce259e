"""Tests of the signs and the consistency of dynamic derivatives."""

from pathlib import Path

import numpy as np
import pytest

import datcom_io
from datcom_io.reading.damping import estimate_tail_share, find_inconsistent

ALPHA = np.array([-4.0, 0.0, 4.0, 8.0, 16.0])
LIFT = 0.2 + 0.09 * ALPHA
SLOPE = np.full(5, 0.45)
# an own light aircraft of two engines, printed with the centre of gravity far from the pole of the
# method [1/rad]
SOUND = {
    "CL_qhat": [8.3, *4 * [np.nan]],
    "Cm_qhat": [-22.5, *4 * [np.nan]],
    "CL_alphadothat": [2.9, 3.0, 3.1, 3.0, 1.0],
    "Cm_alphadothat": [-9.6, -9.9, -10.3, -9.9, -3.0],
    "Cl_phat": [-0.44, -0.45, -0.45, -0.40, 0.10],
    "Cn_phat": [0.015, -0.012, -0.04, -0.07, -0.1],
    "Cn_rhat": [-0.09, -0.09, -0.1, -0.1, -0.11],
    "Cl_rhat": [-0.01, 0.04, 0.1, 0.15, 0.2],
}


def derivatives(**changes: list[float]) -> dict[str, np.ndarray]:
    return {name: np.array(row, float) for name, row in {**SOUND, **changes}.items()}


def wrong(
    slope: np.ndarray = SLOPE, mach: float = 0.2, **changes: list[float]
) -> dict[str, list[bool]]:
    found = find_inconsistent(derivatives(**changes), ALPHA, LIFT, slope, mach)
    return {name: mask.tolist() for name, mask in found.items()}


def test_a_sound_page_has_no_suspect() -> None:
    assert wrong() == {}


def test_the_share_of_the_tail_is_alpha_dot_over_the_slope_of_the_downwash() -> None:
    shares = estimate_tail_share(derivatives(), ALPHA, SLOPE, 0.2)
    # medians of the rows up to 6 deg
    assert shares == {"CL_qhat": pytest.approx(3.0 / 0.45), "Cm_qhat": pytest.approx(-9.9 / 0.45)}


@pytest.mark.parametrize("Cm_qhat", [10.6, -15.0, -41.0])
def test_pitch_damping_that_contradicts_alpha_dot(Cm_qhat: float) -> None:
    """The three kinds of numbers near the pole: positive, too small, too large."""
    assert wrong(Cm_qhat=[Cm_qhat, *4 * [np.nan]]) == {"Cm_qhat": [True, *4 * [False]]}


def test_a_wing_without_tail_is_judged_by_signs() -> None:
    no_tail = np.full(5, np.nan)
    assert wrong(no_tail, Cm_qhat=[-0.5, *4 * [np.nan]]) == {}
    assert list(wrong(no_tail, Cm_qhat=[0.5, *4 * [np.nan]])) == ["Cm_qhat"]


@pytest.mark.parametrize(
    ("name", "row"),
    [
        ("Cl_phat", [0.44, -0.45, -0.45, -0.40, 0.10]),
        ("Cn_rhat", [0.09, -0.09, -0.1, -0.1, -0.11]),
        ("Cm_alphadothat", [9.6, -9.9, -10.3, -9.9, -3.0]),
        ("CL_alphadothat", [-2.9, 3.0, 3.1, 3.0, 1.0]),
        ("Cn_phat", [0.6, -0.012, -0.04, -0.07, -0.1]),
        ("CL_qhat", [60.0, *4 * [np.nan]]),
        ("CY_phat", [-1173.0, 0.1, 0.1, 0.1, 0.1]),
    ],
)
def test_a_sign_or_size_of_its_own_is_flagged_in_its_row(name: str, row: list[float]) -> None:
    assert wrong(**{name: row})[name] == [True, *4 * [False]]


def test_roll_due_to_yaw_has_the_sign_of_the_lift() -> None:
    assert wrong(Cl_rhat=[-0.01, 0.04, -0.3, 0.15, 0.2]) == {
        "Cl_rhat": [False, False, True, False, False]
    }


# An F-104-like fighter: a fin as high as the wing panel is wide, CNR of -1.5.
FIN = {"Cn_rhat": 5 * [-1.5]}


def test_a_high_fin_rolls_an_aeroplane_of_negative_lift() -> None:
    lift = np.array([-0.3, 0.1, 0.5, 0.9, 1.2])
    row = [0.58, 0.5, 0.48, 0.45, 0.4]
    assert find_inconsistent(derivatives(Cl_rhat=row, **FIN), ALPHA, lift, SLOPE, 0.3) == {}
    # without the fin, CLR of that size has the wrong sign
    found = find_inconsistent(derivatives(Cl_rhat=row), ALPHA, lift, SLOPE, 0.3)
    assert {name: mask.tolist() for name, mask in found.items()} == {
        "Cl_rhat": [True, *4 * [False]]
    }


def test_the_fin_of_a_slender_wing_yaws_more_than_the_wing_damps() -> None:
    """A delta of aspect ratio 0.9: CLP -0.088, CNP -0.106 at 4 deg."""
    slender = {"Cl_phat": 5 * [-0.088], "Cn_phat": [-0.04, -0.05, -0.106, -0.1, -0.1]}
    assert wrong(**slender, **FIN) == {}
    assert list(wrong(**slender, Cn_rhat=5 * [-0.02])) == ["Cn_phat"]


def test_yaw_damping_of_a_wing_without_fin_is_small_and_of_either_sign() -> None:
    row = [0.002, -0.0005, -0.002, -0.003, -0.01]
    assert wrong(np.full(5, np.nan), Cn_rhat=row) == {}
    assert list(wrong(Cn_rhat=[0.02, *row[1:]])) == ["Cn_rhat"]


def test_beyond_the_linear_range_signs_are_free() -> None:
    """A stalled wing autorotates: Cl_phat is positive at 16 deg of the sound page."""
    assert SOUND["Cl_phat"][-1] > 0.0
    assert wrong() == {}


# A swept fighter at Mach 1.4 and 1.6: CMQ of -3.3 and -5.0 is right, CMAD holds the wing's share.
SUPERSONIC = {
    "Cm_qhat": [-5.04, *4 * [np.nan]],
    "CL_alphadothat": [-0.85, -0.73, -0.85, -1.0, np.nan],
    "Cm_alphadothat": [0.0002, -0.19, 0.0002, 0.3, np.nan],
}


def test_a_supersonic_wing_has_derivatives_of_alpha_dot_of_either_sign() -> None:
    assert wrong(mach=1.6, **SUPERSONIC) == {}
    assert estimate_tail_share(derivatives(**SUPERSONIC), ALPHA, SLOPE, 1.6) == {}
    # its size counts at any speed
    huge = {**SUPERSONIC, "Cm_alphadothat": [175.0, -0.19, 0.0, 0.3, np.nan]}
    assert list(wrong(mach=1.4, **huge)) == ["Cm_alphadothat"]


@pytest.mark.parametrize("lag", [9.9, -175.0])
def test_a_lag_of_wrong_sign_or_size_gives_no_share_of_the_tail(lag: float) -> None:
    """The share takes the place of a suspect CMQ: a wrong one would be stored as a number."""
    row = 5 * [lag]
    shares = estimate_tail_share(derivatives(Cm_alphadothat=row), ALPHA, SLOPE, 0.2)
    assert list(shares) == ["CL_qhat"]
    assert list(wrong(Cm_alphadothat=row)) == ["Cm_alphadothat"]


LISTINGS = Path(__file__).parents[1] / "listings"


def test_a_tail_without_dynamic_pressure_is_flagged() -> None:
    """The print has Q/QINF of 3.361, 0, 0.01, 0, 0.259, 0.567 and 0.699 at Mach 1.5."""
    listing = datcom_io.read(LISTINGS / "tail_pressure.out")
    tree = listing[0].to_datatree()
    suspect = datcom_io.FLAGS.index("suspect")
    for leaf, name in (("downwash", "q_ratio"), ("static", "CL"), ("static", "Cm_alpha")):
        flags = tree[leaf][f"{name}_flag"].isel(condition=0).values
        assert (flags == suspect).tolist() == 5 * [True] + 2 * [False], name
    (text,) = [item.text for item in listing.messages if "Q/QINF" in item.text]
    assert "at Mach 1.5 2 is impossible (0 to 3.56)" in text
