"""Signs and mutual consistency of the dynamic derivatives of one page.

The tail sees a pitch rate as a change of incidence, and a rate of incidence as a downwash that
arrives late. Both act with the same slope and the same arm, so that the tail's share of CMQ is
CMAD / (d epsilon / d alpha), and likewise CLQ and CLAD [DATCOM 7.4.1.2, 7.4.4.2]. The share of the
wing follows from its planform (`datcom_io.reading.wing_damping`); it is small unless the wing is
far from the moment centre. Both together give CMQ within 0.9 per radian on nearly all listings. The
program's method of the wing-body has a pole over the position of the centre of gravity, near which
the printed CMQ of the aeroplane is wrong in size and sign: an own light aircraft of two engines
prints -27 to +101 per radian over 0.8 chord of XCG, where the shares give -28 to -22.

At supersonic Mach numbers a wing has CLAD and CMAD of its own, of either sign, and the page prints
the sum. Neither the share of the tail nor a sign follows from them there. CMQ is compared with
thin-aerofoil strips of wing and tail and slender-body theory of the body instead. So is CLQ, which
CMQ and CMA of the same page bound more closely
(`datcom_io.reading.wing_damping.bound_supersonic_lift`).

The program multiplies the lift of the tail by Q/QINF. Its supersonic method prints 0 or 3 for some
aircraft, so that the tail is absent from all numbers of the page.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from datcom_io.arrays.conditions import printed_condition
from datcom_io.decks.deck import Deck
from datcom_io.listing import Case
from datcom_io.printout.content import ListingMessage, Page
from datcom_io.printout.tables import PrintedTable
from datcom_io.reading.suspects import column_of_page, columns_of, with_suspects
from datcom_io.reading.wing_damping import (
    BODY_MOST,
    STRIPS_LEAST,
    STRIPS_MOST,
    bound_supersonic_lift,
    estimate_supersonic_shares,
    estimate_wing_share,
)
from datcom_io.reading.wing_scales import scale_by_wing

# Range in which the signs of attached flow hold. [deg]
_LINEAR = 6.0
# From this Mach number on the printed CLAD and CMAD contain those of the wing.
_SUPERSONIC = 1.0
# Least slope of the downwash that can divide.
_LEAST_SLOPE = 0.05
# Wing-body share of CMQ and CLQ where the cards give no planform: part of the tail's share, and
# amount per radian. A wing-body has no positive pitch damping; 10 % leave room for the rounding of
# the print.
_MOMENT_ABOVE, _MOMENT_BELOW, _MOMENT_AMOUNT = 0.10, 0.25, 2.5
_LIFT_PART, _LIFT_AMOUNT = 1.0, 5.0
# Difference of the print from the shares of tail and wing: part of the tail's, part of the wing's,
# and amount per radian. The largest seen are 0.05, 0.16 and 0.9; a body adds damping.
_OFF_TAIL, _OFF_WING = 0.10, 0.35
_OFF_ABOVE, _OFF_BELOW, _OFF_LIFT = 0.3, 1.5, 1.5
# Supersonic CMQ: amount per radian, and part of that of the strips: sqrt(0.35 1.1) is about 0.7.
_STRIPS_AMOUNT, _STRIPS_MEDIAN = 0.5, 0.7
# Lift from which the rolling moment due to yaw has the sign of the lift, but for the share of a
# vertical tail.
_LIFTING, _TAIL_CLR = 0.2, 0.2
# A fin at height z and arm l adds -CNR z / l to CLR, and a part of it to CNP. Parts of |CNR|.
_FIN_CLR, _FIN_CNP = 0.5, 0.25
# Largest sizes of a derivative of an aeroplane by the quantities of its main wing. [1/rad]
LARGEST = {
    "CL_qhat": 50.0,
    "Cm_qhat": 150.0,
    "CL_alphadothat": 30.0,
    "Cm_alphadothat": 80.0,
    "Cl_phat": 3.0,
    "Cn_rhat": 3.0,
    "Cl_rhat": 2.0,
    "Cn_phat": 1.5,
    "CY_phat": 3.0,
}
# Sign in attached flow: damping opposes its rate; a late downwash lifts the tail down.
_SIGNS = {
    "Cm_qhat": -1,
    "Cl_phat": -1,
    "Cn_rhat": -1,
    "Cm_alphadothat": -1,
    "CL_alphadothat": 1,
}  # A wing without fin damps yaw by its drag alone: +-0.003 per radian, of either sign at low lift.
_SIGN_MARGIN = {"Cn_rhat": 0.01}

# What to do about a suspect derivative: the pole concerns the pitch rate alone.
_POLE = (
    "the program's method of the damping of a wing-body has a pole over XCG, so move XCG by a "
    "tenth of a chord and compare"
)
_ADVICE = {"CL_qhat": _POLE, "Cm_qhat": _POLE}
_OTHER_ADVICE = (
    "compare with a neighbouring Mach number, and check CBARR, BLREF and the planforms of the deck"
)

Derivatives = Mapping[str, np.ndarray]


def estimate_tail_share(
    derivatives: Derivatives,
    alpha: np.ndarray,
    downwash_slope: np.ndarray,
    mach: float,
    scales: Mapping[str, float] | None = None,
) -> dict[str, float]:
    """Return CLQ and CMQ of the tail from CLAD and CMAD and the downwash.

    Parameters
    ----------
    derivatives : mapping of str to array (alpha,)
        With ``CL_alphadothat`` and ``Cm_alphadothat``. [1/rad]
    alpha : array (alpha,)
        Angle of attack. [deg]
    downwash_slope : array (alpha,)
        d epsilon / d alpha, NaN where it is not printed.
    mach : float
        Mach number of the page.
    scales : mapping of str to float, optional
        `scale_by_wing` of the deck; by default the derivatives are by the quantities of the wing.

    Returns
    -------
    dict of str to float
        ``CL_qhat`` and ``Cm_qhat``: medians over the linear range. A derivative without a sound
        number there is absent, as are both at supersonic Mach numbers. [1/rad]
    """
    shares: dict[str, float] = {}
    if mach >= _SUPERSONIC:
        return shares
    is_usable = (np.abs(alpha) <= _LINEAR) & (downwash_slope > _LEAST_SLOPE)
    for name in ("CL", "Cm"):
        lag = derivatives[f"{name}_alphadothat"]
        scale = (scales or {}).get(f"{name}_alphadothat", 1.0)
        # A lag of the wrong sign or size states nothing about the tail; NaN compares false.
        is_sound = _SIGNS[f"{name}_alphadothat"] * lag > 0.0
        rows = is_usable & is_sound & (np.abs(scale * lag) <= LARGEST[f"{name}_alphadothat"])
        if rows.any():
            shares[f"{name}_qhat"] = float(np.median(lag[rows] / downwash_slope[rows]))
    return shares


def find_inconsistent(
    derivatives: Derivatives,
    alpha: np.ndarray,
    lift: np.ndarray,
    downwash_slope: np.ndarray,
    mach: float,
    wing: Mapping[str, float] | None = None,
    has_tail: bool | None = None,
    strips: Mapping[str, float] | None = None,
    moment_slope: float = math.nan,
) -> dict[str, np.ndarray]:
    """Return masks of the numbers that contradict their sign, their size or each other.

    All numbers are by area, span and mean chord of the main wing (`scale_by_wing`).

    Parameters
    ----------
    derivatives : mapping of str to array (alpha,)
        ``CL_qhat``, ``Cm_qhat``, ``CL_alphadothat``, ``Cm_alphadothat``, ``Cl_phat``, ``Cn_phat``,
        ``Cn_rhat``, ``Cl_rhat``, and ``CY_phat`` if it is at hand, NaN where nothing is printed.
        [1/rad]
    alpha : array (alpha,)
        Angle of attack. [deg]
    lift : array (alpha,)
        Lift coefficient, NaN where it is not printed.
    downwash_slope : array (alpha,)
        d epsilon / d alpha, NaN without a tail behind the wing.
    mach : float
        Mach number of the page.
    wing : mapping of str to float, optional
        ``CL_qhat`` and ``Cm_qhat`` of the wing (`estimate_wing_share`). [1/rad]
    has_tail : bool, optional
        Whether the page is that of an aeroplane with a second surface; by default, whether a
        downwash is printed.
    strips : mapping of str to float, optional
        CMQ and CLQ at supersonic speed (`estimate_supersonic_shares`). [1/rad]
    moment_slope : float, optional
        CMA of the page, NaN if it is not printed. [1/rad]

    Returns
    -------
    dict of str to array (alpha,) of bool
        By derivative; only those with a number that is inconsistent.
    """
    is_linear = np.abs(alpha) <= _LINEAR
    has_downwash = bool(np.isfinite(downwash_slope).any())
    if has_tail is None:
        has_tail = has_downwash
    # Without a tail, or with the share of a supersonic wing, the lag has no sign of its own.
    has_lag_sign = has_downwash and mach < _SUPERSONIC
    wrong = _find_wrong_signs(derivatives, is_linear, has_lag_sign)
    is_reversed, is_too_large = _find_wrong_cross(derivatives, lift)
    wrong["Cl_rhat"] |= is_linear & is_reversed
    wrong["Cn_phat"] |= is_linear & is_too_large
    shares = estimate_tail_share(derivatives, alpha, downwash_slope, mach)
    for name in ("CL_qhat", "Cm_qhat"):
        # A tail without downwash, such as that behind a canard, leaves its share unknown.
        if name in shares or (wing and not has_tail):
            low, high = _expected_rates(name, shares.get(name, 0.0), (wing or {}).get(name))
            wrong[name] = wrong[name] | (derivatives[name] < low) | (derivatives[name] > high)
    CL_q, Cm_q = derivatives["CL_qhat"], derivatives["Cm_qhat"]
    if strips:
        low = STRIPS_MOST * strips["surfaces"] + BODY_MOST * min(0.0, strips["body"])
        high = STRIPS_LEAST * strips["surfaces"]
        wrong["Cm_qhat"] = wrong["Cm_qhat"] | (Cm_q < low - _STRIPS_AMOUNT) | (Cm_q > high)
    damping = _first_sound(Cm_q, wrong["Cm_qhat"])
    low, high = bound_supersonic_lift(mach, strips or {}, damping, moment_slope)
    wrong["CL_qhat"] = wrong["CL_qhat"] | (CL_q < low) | (CL_q > high)
    return {name: mask for name, mask in wrong.items() if mask.any()}


def _find_wrong_signs(
    derivatives: Derivatives, is_linear: np.ndarray, has_lag_sign: bool
) -> dict[str, np.ndarray]:
    """Return masks of the numbers that are too large, or of the other sign in attached flow."""
    wrong = {}
    for name, largest in LARGEST.items():
        if name in derivatives:
            wrong[name] = np.abs(derivatives[name]) > largest
    for name, sign in _SIGNS.items():
        if name.endswith("alphadothat") and not has_lag_sign:
            continue
        # CMQ and CLQ are printed once, in the first row, for all angles.
        rows = is_linear | (name == "Cm_qhat")
        margin = _SIGN_MARGIN.get(name, 0.0)
        wrong[name] |= rows & (sign * derivatives[name] < -margin)
    return wrong


def _find_wrong_cross(derivatives: Derivatives, lift: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return masks of the CLR of the wrong sign, and of the CNP that are too large."""
    fin = np.abs(np.nan_to_num(derivatives["Cn_rhat"]))
    # A wing that lifts more on the advancing side rolls away from it: CLR has the sign of CL.
    Cl_r = derivatives["Cl_rhat"]
    is_reversed = (lift > _LIFTING) & (Cl_r < -_TAIL_CLR)
    is_reversed |= (lift < -_LIFTING) & (Cl_r > _TAIL_CLR + _FIN_CLR * fin)
    # The yaw of a rolling aeroplane is a part of its roll damping, but for the share of the fin.
    largest_Cn_p = np.abs(derivatives["Cl_phat"]) + _FIN_CNP * fin
    return is_reversed, np.abs(derivatives["Cn_phat"]) > largest_Cn_p


def _first_sound(values: np.ndarray, is_wrong: np.ndarray) -> float:
    """Return the first number that is printed and not wrong, NaN if there is none."""
    sound = values[np.isfinite(values) & ~is_wrong]
    if sound.size:
        return float(sound[0])
    return math.nan


def _expected_rates(name: str, tail: float, wing: float | None) -> tuple[float, float]:
    """Return the lowest and highest CLQ or CMQ that fits the shares of tail and wing. [1/rad]"""
    part = abs(tail)
    if wing is not None:
        room = _OFF_TAIL * part + _OFF_WING * abs(wing)
        if name == "CL_qhat":
            return tail + wing - room - _OFF_LIFT, tail + wing + room + _OFF_LIFT
        return tail + wing - room - _OFF_BELOW, tail + wing + room + _OFF_ABOVE
    if name == "CL_qhat":
        room = _LIFT_PART * part + _LIFT_AMOUNT
        return tail - room, tail + room
    return tail - _MOMENT_BELOW * part - _MOMENT_AMOUNT, tail + _MOMENT_ABOVE * part


def estimate_supersonic_damping(deck: Deck, mach: float, has_tail: bool) -> float:
    """Return CMQ of an aeroplane at supersonic speed, NaN where the method does not hold. [1/rad]

    It is 0.7 of that of the strips, the median of the print, and that of the body if it damps.
    """
    shares = estimate_supersonic_shares(deck, mach, has_tail)
    if not shares:
        return math.nan
    return _STRIPS_MEDIAN * shares["surfaces"] + min(0.0, shares["body"])


@dataclass(frozen=True)
class _DynamicPage:
    """Numbers of a page with dynamic derivatives by the quantities of the deck.

    Times `scales` they are by those of the main wing, as `find_inconsistent` takes them.
    """

    derivatives: Derivatives
    alpha: np.ndarray
    lift: np.ndarray
    downwash_slope: np.ndarray
    mach: float
    wing: Mapping[str, float]
    has_tail: bool
    strips: Mapping[str, float]
    moment_slope: float
    scales: Mapping[str, float]

    def by_wing(self) -> _DynamicPage:
        """Return the numbers by area, span and mean chord of the main wing."""
        scales = self.scales
        chord = scales["Cm_alpha"] / scales["CL"]
        strips = {}
        for name, value in self.strips.items():
            if name == "arm":
                strips[name] = value * chord
            elif name in ("surfaces", "body", "wing"):
                strips[name] = value * scales["Cm_qhat"]
            else:
                strips[name] = value * scales["CL_qhat"]
        return replace(
            self,
            derivatives={name: scales[name] * x for name, x in self.derivatives.items()},
            lift=scales["CL"] * self.lift,
            wing={name: scales[name] * x for name, x in self.wing.items()},
            strips=strips,
            moment_slope=scales["Cm_alpha"] * self.moment_slope,
            scales=dict.fromkeys(scales, 1.0),
        )

    def find_inconsistent(self) -> dict[str, np.ndarray]:
        """Return masks of the inconsistent numbers by derivative."""
        return find_inconsistent(
            self.derivatives,
            self.alpha,
            self.lift,
            self.downwash_slope,
            self.mach,
            wing=self.wing,
            has_tail=self.has_tail,
            strips=self.strips,
            moment_slope=self.moment_slope,
        )


def flag_damping(case: Case) -> None:
    """Flag the dynamic derivatives of wings with others that are inconsistent, and report them."""
    static_pages = {
        (page.configuration, printed_condition(page)): page
        for page in case.pages
        if page.kind == "static" and math.isinf(page.ground_height)
    }
    # Reported once by configuration and derivative, with the first number and all Mach numbers.
    reports: dict[tuple[str, str], tuple[int, str, list[float]]] = {}
    for i, page in enumerate(case.pages):
        table = page.table("dynamic")
        if table is None or "WING" not in page.configuration:
            continue
        static = static_pages.get((page.configuration, printed_condition(page)))
        numbers = _read_dynamic_page(case.deck, page, table, static)
        wrong = numbers.by_wing().find_inconsistent()
        for name, mask in wrong.items():
            page = with_suspects(page, "dynamic", (name,), mask)
            line = table.lines[int(np.argmax(mask))]
            first = (line, _describe_number(numbers, name, wrong), list[float]())
            _, _, machs = reports.setdefault((page.configuration, name), first)
            machs.append(numbers.mach)
        case.pages[i] = page
    for (configuration, name), (line, text, machs) in reports.items():
        at = " ".join(f"{mach:g}" for mach in dict.fromkeys(machs))
        sentence = f"{name} of {configuration} is inconsistent in sign or size at Mach {at} "
        sentence += f"({text}) and is flagged suspect; {_ADVICE.get(name, _OTHER_ADVICE)}"
        case.messages.append(ListingMessage(line, sentence, "reader"))


def _read_dynamic_page(
    deck: Deck, page: Page, table: PrintedTable, static: Page | None
) -> _DynamicPage:
    """Return the numbers of a page, with those of the static page of the same condition."""
    columns = columns_of(table)
    alpha = columns["alpha"]
    per_radian = 1.0
    if deck.deriv == "DEG":
        per_radian = math.degrees(1.0)
    mach = page.condition("mach")
    has_tail = "HORIZONTAL" in page.configuration
    # CMA is the median of the printed slopes in the linear range.
    moments = per_radian * column_of_page(static, "static", "Cm_alpha", alpha)
    moments = moments[np.isfinite(moments) & (np.abs(alpha) <= _LINEAR)]
    moment_slope = math.nan
    if moments.size:
        moment_slope = float(np.median(moments))
    return _DynamicPage(
        derivatives={name: per_radian * columns[name] for name in LARGEST},
        alpha=alpha,
        lift=column_of_page(static, "static", "CL", alpha),
        downwash_slope=column_of_page(static, "downwash", "epsilon_alpha", alpha),
        mach=mach,
        wing=estimate_wing_share(deck, mach),
        has_tail=has_tail,
        strips=estimate_supersonic_shares(deck, mach, has_tail),
        moment_slope=moment_slope,
        scales=scale_by_wing(deck),
    )


def _describe_number(numbers: _DynamicPage, name: str, wrong: Mapping[str, np.ndarray]) -> str:
    """Return the first inconsistent number of a derivative, and what others give in its place."""
    row = int(np.argmax(wrong[name]))
    value, alpha = numbers.derivatives[name][row], numbers.alpha[row]
    text = f"{value:.4g} per radian at alpha {alpha:g} deg"
    shares = estimate_tail_share(
        numbers.derivatives,
        numbers.alpha,
        numbers.downwash_slope,
        numbers.mach,
        scales=numbers.scales,
    )
    if name in shares:
        text += ", where the derivatives of alpha-dot and the downwash of the page give "
        text += f"{shares[name]:.4g} for the tail alone"
    if name in numbers.wing and (name in shares or not numbers.has_tail):
        text += f", and the planform gives {numbers.wing[name]:.4g} for the wing"
    if name == "Cm_qhat" and numbers.strips:
        text += f", where strips of the planforms give {numbers.strips['surfaces']:.4g} and the "
        text += f"body {numbers.strips['body']:.4g}"
    # A wrong CMQ of the page does not bound CLQ.
    if name == "CL_qhat" and numbers.mach >= _SUPERSONIC:
        none_wrong = np.zeros(numbers.alpha.size, bool)
        is_wrong = wrong.get("Cm_qhat", none_wrong)
        # the bounds have amounts that hold by the main wing
        own, scale = numbers.by_wing(), numbers.scales["CL_qhat"]
        damping = _first_sound(own.derivatives["Cm_qhat"], is_wrong)
        bounds = bound_supersonic_lift(own.mach, own.strips, damping, own.moment_slope)
        low, high = (bound / scale for bound in bounds)
        text += f", where strips of the planforms, CMQ and CMA allow {low:.4g} to {high:.4g}"
    return text
