"""Tests of the pitch damping of a wing by its planform against prints of the program."""

from pathlib import Path

import numpy as np
import pytest

import datcom_io
from datcom_io.decks.deck_file import read_deck
from datcom_io.reading.damping import estimate_tail_share, find_inconsistent
from datcom_io.reading.wing_damping import (
    bound_supersonic_lift,
    estimate_supersonic_shares,
    estimate_wing_share,
)
from datcom_io.reading.wing_scales import scale_by_wing

T37 = Path(__file__).parents[3] / "data" / "t37" / "datcom"
# A transport of aspect ratio 15 whose centre of gravity lies ahead of the wing, in feet. The
# program prints CLQ 16.72 and CMQ -20.67 per radian at Mach 0.2, 18.20 and -22.46 at 0.6.
FORWARD = """\
 $FLTCON NMACH=1.0,MACH(1)=0.2$
 $OPTINS SREF=3455.0,CBARR=16.3,BLREF=233.0$
 $SYNTHS XCG=49.0,ZCG=-0.47,XW=42.6,ZW=-2.12,XH=70.5,ZH=0.78$
 $WGPLNF CHRDR=21.3,CHRDTP=9.5,SSPN=111.4,SSPNE=106.8,
  SAVSI=18.0,CHSTAT=0.25,TYPE=1.0$
 $HTPLNF CHRDR=22.96,CHRDTP=10.2,SSPN=32.2,SSPNE=30.0,SAVSI=28.2,CHSTAT=0.25,TYPE=1.0$
"""
# Printed with them: alpha-dot derivatives over the slope of the downwash.
TAIL = {"CL_qhat": 5.24, "Cm_qhat": -11.45}


def deck(text: str):
    (case,) = read_deck(text.splitlines())
    return case


@pytest.mark.parametrize(("name", "printed"), [("CL_qhat", 16.72), ("Cm_qhat", -20.67)])
def test_tail_and_wing_together_are_the_print(name: str, printed: float) -> None:
    wing = estimate_wing_share(deck(FORWARD), 0.2)
    assert TAIL[name] + wing[name] == pytest.approx(printed, rel=0.09)


def test_a_rectangular_wing_by_hand() -> None:
    """A = 6, the aerodynamic centre half a chord behind the moment centre, Mach 0.

    CLq = (1/2 + 2/2) 12 pi/(2 + sqrt(40)), Cmq = -0.7 2 pi (6 (0.25 + 0.5)/(6 + 2) + 1/8).
    """
    text = " $SYNTHS XCG=-2.5,XW=0.0$\n"
    text += " $WGPLNF CHRDR=10.0,CHRDTP=10.0,SSPN=30.0,SSPNE=30.0,SAVSI=0.0,CHSTAT=0.25,TYPE=1.0$\n"
    wing = estimate_wing_share(deck(text), 0.0)
    assert wing["CL_qhat"] == pytest.approx(6.7935, rel=1e-4)
    assert wing["Cm_qhat"] == pytest.approx(-3.0238, rel=1e-4)


def test_a_wing_body_of_the_t37_is_the_planform() -> None:
    """CLQ 2.11 and CMQ -0.50 per radian are printed at Mach 0.2."""
    case = datcom_io.read(T37 / "t37_build.out")[0]
    wing = estimate_wing_share(case.deck, 0.2)
    assert wing["CL_qhat"] == pytest.approx(2.11, abs=0.1)
    assert wing["Cm_qhat"] == pytest.approx(-0.50, abs=0.05)


def test_the_method_ends_below_the_speed_of_sound() -> None:
    assert estimate_wing_share(deck(FORWARD), 0.95) == {}
    assert estimate_wing_share(deck(FORWARD), float("nan")) == {}


def page(Cm_qhat: float, CL_qhat: float = 16.72) -> dict[str, np.ndarray]:
    """Return the derivatives of the transport; alpha-dot over 0.35 is the share of the tail."""
    first = np.array([1.0, np.nan, np.nan])
    every = np.ones(3)
    return {
        "CL_qhat": CL_qhat * first,
        "Cm_qhat": Cm_qhat * first,
        "CL_alphadothat": 0.35 * TAIL["CL_qhat"] * every,
        "Cm_alphadothat": 0.35 * TAIL["Cm_qhat"] * every,
        "Cl_phat": -0.45 * every,
        "Cn_phat": -0.05 * every,
        "Cn_rhat": -0.05 * every,
        "Cl_rhat": 0.1 * every,
    }


def judge(derivatives: dict[str, np.ndarray], slope: float = 0.35, **more) -> list[str]:
    alpha, lift = np.array([-2.0, 0.0, 2.0]), np.array([0.1, 0.3, 0.5])
    return list(find_inconsistent(derivatives, alpha, lift, np.full(3, slope), 0.2, **more))


def test_a_wing_far_behind_the_centre_of_gravity_damps_as_much_as_the_tail() -> None:
    wing = estimate_wing_share(deck(FORWARD), 0.2)
    assert judge(page(-20.67), wing=wing) == []
    # Without the planform the whole counts as that of the tail.
    assert judge(page(-20.67)) == ["CL_qhat", "Cm_qhat"]
    alpha = np.array([-2.0, 0.0, 2.0])
    shares = estimate_tail_share(page(-20.67), alpha, np.full(3, 0.35), 0.2)
    assert shares == {name: pytest.approx(value) for name, value in TAIL.items()}


@pytest.mark.parametrize("Cm_qhat", [-11.0, -31.0, 5.0])
def test_a_print_off_tail_and_wing_is_inconsistent(Cm_qhat: float) -> None:
    wing = estimate_wing_share(deck(FORWARD), 0.2)
    assert judge(page(Cm_qhat), wing=wing) == ["Cm_qhat"]


@pytest.mark.parametrize(("Cm_qhat", "expected"), [(-10.0, []), (-41.0, ["Cm_qhat"])])
def test_a_wing_without_tail_is_judged_by_its_planform(Cm_qhat: float, expected: list[str]) -> None:
    wing = estimate_wing_share(deck(FORWARD), 0.2)
    derivatives = page(Cm_qhat, CL_qhat=12.0)
    assert judge(derivatives, slope=np.nan, wing=wing, has_tail=False) == expected
    # The share of a tail without downwash, as behind a canard, is not known.
    assert judge(derivatives, slope=np.nan, wing=wing, has_tail=True) == []


# A fighter of aspect ratio 2.7. The program prints CMQ of -1.34 per radian for the wing-body and of
# -3.71 for the aeroplane at Mach 1.6, -0.83 and -2.28 at Mach 2.5.
FIGHTER = """\
 $FLTCON NMACH=1.0,MACH(1)=1.6$
 $OPTINS SREF=30.0,CBARR=3.6,BLREF=9.0$
 $SYNTHS XCG=7.5,ZCG=0.0,XW=5.0,ZW=0.0,XH=11.0,ZH=0.0$
 $BODY NX=9.0,X(1)=0.0,1.0,2.0,4.0,6.0,8.0,10.0,12.0,13.5,
  R(1)=0.0,0.35,0.55,0.75,0.8,0.8,0.75,0.65,0.55$
 $WGPLNF CHRDR=5.2,CHRDTP=1.4,SSPN=4.5,SSPNE=3.7,SAVSI=45.0,CHSTAT=0.0,TYPE=1.0$
 $HTPLNF CHRDR=2.2,CHRDTP=0.9,SSPN=2.6,SSPNE=1.9,SAVSI=45.0,CHSTAT=0.0,TYPE=1.0$
"""


@pytest.mark.parametrize(("mach", "part", "whole"), [(1.6, -1.34, -3.71), (2.5, -0.83, -2.28)])
def test_supersonic_strips_bound_the_print(mach: float, part: float, whole: float) -> None:
    """The print is 0.68 to 1.03 of them."""
    case = deck(FIGHTER)
    wing_body = estimate_supersonic_shares(case, mach, has_tail=False)
    aeroplane = estimate_supersonic_shares(case, mach, has_tail=True)
    assert part / wing_body["surfaces"] == pytest.approx(0.97, abs=0.07)
    assert whole / aeroplane["surfaces"] == pytest.approx(0.72, abs=0.05)
    # Slender body: -4 / (S c^2) {6^2 0.950 - integral of (x - 7.5) S dx, -3.18}.
    assert wing_body["body"] == aeroplane["body"] == pytest.approx(-0.3847, abs=1e-3)


def test_a_rectangular_wing_at_the_centre_of_gravity_is_a_closed_form() -> None:
    """Chord c about its middle: Cmq = -2 (4 / sqrt(M^2 - 1)) / 12 = -0.385 at Mach 2."""
    text = " $OPTINS SREF=10.0,CBARR=1.0,BLREF=10.0$\n $SYNTHS XCG=0.5,XW=0.0$\n"
    text += " $WGPLNF CHRDR=1.0,CHRDTP=1.0,SSPN=5.0,SSPNE=5.0,SAVSI=0.0,CHSTAT=0.0,TYPE=1.0$\n"
    shares = estimate_supersonic_shares(deck(text), 2.0, has_tail=False)
    assert shares.pop("surfaces") == pytest.approx(-8.0 / 12.0 / 3.0**0.5)
    assert shares["lift_wing"] == shares["slender_wing"] == pytest.approx(0.0, abs=1e-12)
    # Behind its Mach cone all lift has the incidence of the trailing edge: K (1/2) (2 S / (S c)),
    # here with K = pi A / 2 of a chord of 1 at Mach 1.
    sonic = estimate_supersonic_shares(deck(text), 1.0, has_tail=False)
    assert sonic["slender_wing"] == pytest.approx(5.0 * np.pi)
    # Half a chord ahead of the leading edge, one ahead of the middle: CLq = 2 (4 / sqrt(3)).
    text = text.replace("XCG=0.5", "XCG=-0.5")
    shares = estimate_supersonic_shares(deck(text), 2.0, has_tail=False)
    assert shares["lift_wing"] == pytest.approx(8.0 / 3.0**0.5)
    # No tail in the deck, and speeds at which the method does not hold.
    assert estimate_supersonic_shares(deck(text), 2.0, has_tail=True) == {}
    assert estimate_supersonic_shares(deck(text), 0.9, has_tail=False) == {}
    assert estimate_supersonic_shares(deck(text), float("nan"), has_tail=False) == {}


@pytest.mark.parametrize(
    ("factor", "expected"),
    [(1.0, []), (0.6, []), (1.6, []), (0.1, ["Cm_qhat"]), (3.0, ["Cm_qhat"]), (-1.0, ["Cm_qhat"])],
)
def test_a_supersonic_print_off_the_strips_is_inconsistent(factor: float, expected) -> None:
    strips = estimate_supersonic_shares(deck(FIGHTER), 1.6, has_tail=True)
    derivatives = page(-3.71 * factor, CL_qhat=3.63)
    alpha, lift = np.array([-2.0, 0.0, 2.0]), np.array([0.1, 0.3, 0.5])
    more = {"has_tail": True, "strips": strips}
    slope = np.full(3, 0.35)
    assert list(find_inconsistent(derivatives, alpha, lift, slope, 1.6, **more)) == expected


def fighter_bounds(damping: float, moment_slope: float) -> tuple[float, float]:
    strips = estimate_supersonic_shares(deck(FIGHTER), 1.6, has_tail=True)
    return bound_supersonic_lift(1.6, strips, damping, moment_slope)


def test_damping_and_moment_slope_bound_the_lift_due_to_pitch_rate() -> None:
    """The program prints CLQ 3.63, CMQ -3.71 and CMA -1.41 per radian."""
    assert fighter_bounds(np.nan, np.nan) == pytest.approx((0.16, 6.87), abs=0.01)
    # Wing 2.03 and CMQ -1.38 by strips, body 0.21 and -0.39, arm 1.51: at 1.15 arms the least is
    # 0.25 (2.03 - 1.38 / 1.74) + 3.71 / 1.74 + 1.5 (0.21 - 0.39 / 1.74) - 0.5.
    assert fighter_bounds(-3.71, np.nan) == pytest.approx((1.913, 4.934), abs=0.01)
    # CLq of at least 0.7 (2.82) - 0.25 by CMA.
    assert fighter_bounds(np.nan, -1.41) == pytest.approx((1.724, 6.87), abs=0.01)
    # Transonic pages, and those without cards.
    assert bound_supersonic_lift(1.2, {}, -3.71, -1.41) == (-np.inf, np.inf)
    assert bound_supersonic_lift(1.6, {}, -3.71, -1.41)[0] == pytest.approx(1.724)


FACTORS = (1.0, 0.6, 0.1, -1.0, 3.0, 57.3)


@pytest.mark.parametrize("factor", FACTORS)
def test_a_supersonic_lift_due_to_pitch_rate_beyond_its_bounds(factor: float) -> None:
    strips = estimate_supersonic_shares(deck(FIGHTER), 1.6, has_tail=True)
    derivatives = page(-3.71, CL_qhat=3.63 * factor)
    alpha, lift = np.array([-2.0, 0.0, 2.0]), np.array([0.1, 0.3, 0.5])
    more = {"has_tail": True, "strips": strips, "moment_slope": -1.41}
    expected = ["CL_qhat"]
    if factor in (1.0, 0.6):
        expected = []
    found = find_inconsistent(derivatives, alpha, lift, np.full(3, 0.35), 1.6, **more)
    assert list(found) == expected


def test_a_wrong_damping_does_not_make_the_lift_due_to_pitch_rate_suspect() -> None:
    strips = estimate_supersonic_shares(deck(FIGHTER), 1.6, has_tail=True)
    derivatives = page(-37.1, CL_qhat=3.63)
    alpha, lift = np.array([-2.0, 0.0, 2.0]), np.array([0.1, 0.3, 0.5])
    more = {"has_tail": True, "strips": strips, "moment_slope": -1.41}
    found = find_inconsistent(derivatives, alpha, lift, np.full(3, 0.35), 1.6, **more)
    assert list(found) == ["Cm_qhat"]


def test_factors_to_the_quantities_of_the_wing() -> None:
    """A rectangular wing of 10 m2, chord 1 m and span 10 m."""
    wing = " $WGPLNF CHRDR=1.0,CHRDTP=1.0,SSPN=5.0,SSPNE=5.0,SAVSI=0.0,CHSTAT=0.0,TYPE=1.0$\n"
    scales = scale_by_wing(deck(" $OPTINS SREF=20.0,CBARR=0.5,BLREF=1.0$\n" + wing))
    expected = {"CL": 2.0, "CL_qhat": 1.0, "Cm_qhat": 0.5, "Cl_beta": 0.2, "Cl_phat": 0.02}
    assert {name: scales[name] for name in expected} == pytest.approx(expected)
    assert set(scale_by_wing(deck(wing)).values()) == {1.0}
    # of a canard configuration the main wing is the larger surface
    tail = wing.replace("WGPLNF", "HTPLNF").replace("=5.0", "=10.0")
    assert scale_by_wing(deck(" $OPTINS SREF=20.0$\n" + wing + tail))["CL"] == pytest.approx(1.0)


def test_limits_of_size_do_not_depend_on_the_mean_chord() -> None:
    """With a tenth of the chord CMQ and CMAD are a hundred times as large, CLQ and CLAD ten
    times.
    """
    case = deck(FORWARD.replace("CBARR=16.3", "CBARR=1.63"))
    powers = {"CL_qhat": 1, "CL_alphadothat": 1, "Cm_qhat": 2, "Cm_alphadothat": 2}
    printed = {name: x * 10.0 ** powers.get(name, 0) for name, x in page(-20.67).items()}
    alpha, slope = np.array([-2.0, 0.0, 2.0]), np.full(3, 0.35)
    assert estimate_tail_share(printed, alpha, slope, 0.2) == {
        "CL_qhat": pytest.approx(10.0 * TAIL["CL_qhat"])
    }
    shares = estimate_tail_share(printed, alpha, slope, 0.2, scales=scale_by_wing(case))
    assert shares["Cm_qhat"] == pytest.approx(100.0 * TAIL["Cm_qhat"])
