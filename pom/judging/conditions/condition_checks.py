"""Checks of the conditions that a row of the tolerance table states for the flight.

Every check looks at one case.  It returns a text if the condition does not hold, an empty one if it
holds, and raises `NotChecked` if record or aircraft file lack what it needs.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from flightmech.units import DEGREE, FOOT, KNOT, POUND_FORCE
from pom.cases.case_facts import file_facts
from pom.judging.conditions.configurations import FLAPS_OUT, flap_angle
from pom.judging.conditions.flown_case import FlownCase, NotChecked, control_travel
from pom.tolerances.channels import channel_value_text, plain_id

BRAKED, RELEASED = 0.95, 0.02  # of the pedal; our numbers for a full and for no brake
SHARE_OF_RUN = 0.8  # tests 1.b.1, 1.e.1, 1.e.2
SHARE_OF_V1 = 0.8  # test 1.b.7
NEAR_MAXIMUM = 0.8  # rule R13: of the range between basic operating and largest weight
MOVED = 1.0 * DEGREE  # of a surface of a free response; the elevator of the trim row 2.c.5
FORCED = {"F_column": 5.0 * POUND_FORCE, "F_rim": 3.0 * POUND_FORCE, "F_pedal": 5.0 * POUND_FORCE}
"""Pilot force of a free response: the tolerances of the static rows 2.a.1.a to 2.a.3.a. [N]"""
SMOOTH = 0.3  # [s] mean over which noise of a pick-up is not a movement
ALLOWANCE = 1.0 * DEGREE  # of a bank angle that a pilot holds
STOPPED_ENGINE = 0.1  # thrust over that of the other engines
BACK = 0.1  # of the largest change: a control is back at neutral
_RATES = {"2.b.4": "q", "2.b.5": "p", "2.b.6": "r"}


def _brakes(flown: FlownCase) -> np.ndarray:
    left, right = flown.channel("brake_left"), flown.channel("brake_right")
    return np.minimum(left, right)


def _check_no_brakes(flown: FlownCase) -> str:
    most = float(np.nanmax(np.maximum(flown.channel("brake_left"), flown.channel("brake_right"))))
    if most <= RELEASED:
        return ""
    return f"a brake is at {100.0 * most:.0f} % of the pedal, the row has no brakes"


def _check_maximum_braking(flown: FlownCase) -> str:
    brakes = _brakes(flown)
    start = flown.case.events.get("brake_release", flown.flight.time[0])
    # the brakes that hold the aeroplane before the start do not count
    moving = flown.flight.time > start + 1.0
    if not moving.any():
        raise NotChecked("the window ends at the brake release")
    most = float(np.nanmax(brakes[moving]))
    if most >= BRAKED:
        return ""
    return f"brakes at {100.0 * most:.0f} % of the pedal at most, the row has maximum braking"


def _check_v1(flown: FlownCase) -> str:
    most = float(np.nanmax(flown.channel("V_cas")))
    speed = flown.fact("v1")
    if most >= SHARE_OF_V1 * speed:
        return ""
    return (
        f"rejected below {most / KNOT:.3g} kt, {100.0 * most / speed:.0f} % of V1 "
        f"({speed / KNOT:.3g} kt); the row has 80 % or more"
    )


def _check_weight(flown: FlownCase) -> str:
    mass = flown.case.conditions.get("mass")
    if mass is None:
        mass = float(flown.channel("mass")[0])
    empty, most = flown.fact("basic_operating_weight"), flown.fact("mtow")
    least = empty + NEAR_MAXIMUM * (most - empty)
    if mass >= least:
        return ""
    return f"mass {mass:.0f} kg; near maximum take-off weight is {least:.0f} kg or more"


def _check_share(flown: FlownCase) -> str:
    """Return the recorded share of the run if it is below 80 %."""
    start, stop = flown.case.window
    for criterion in flown.judged():
        first, last = (flown.case.events.get(event) for event in criterion.bounds)
        if first is None or last is None or not last > first:
            continue
        share = (min(stop, last) - max(start, first)) / (last - first)
        if share < SHARE_OF_RUN:
            return f"{100.0 * share:.0f} % of the run is in the window, the row has 80 % or more"
        return ""
    raise NotChecked("the events of the run are not given")


def _first_window(flown: FlownCase) -> tuple[float, float]:
    judged = flown.judged()
    if not judged:
        raise NotChecked("no row applies")
    return judged[0].window


def _check_hands_off(flown: FlownCase) -> str:
    """Return the controls that the pilot moves in a free response; empty without one."""
    start, stop = _first_window(flown)
    inside = flown.inside(start, stop)
    time = flown.flight.time[inside]
    is_forced = flown.case.drive.level == "force"
    limits = FORCED if is_forced else dict.fromkeys(("delta_e", "delta_a", "delta_r"), MOVED)
    texts = []
    known = 0
    for name, most in limits.items():
        if name not in flown.flight or time.size < 2:
            continue
        known += 1
        values = np.asarray(flown.flight[name], float)[inside]
        width = max(1, round(SMOOTH / float(np.median(np.diff(time)))))
        smooth = scipy.ndimage.uniform_filter1d(values, width, mode="nearest")
        moved = np.abs(smooth - smooth[0])
        worst = int(np.nanargmax(moved))
        if moved[worst] > most:
            texts.append(f"{channel_value_text(name, float(moved[worst]))} at {time[worst]:.1f} s")
    if not known:
        raise NotChecked(f"the record has no {' or '.join(limits)}")
    if not texts:
        return ""
    return f"the pilot moves {', '.join(texts)}; the row has a free response without pilot input"


def _check_bank(flown: FlownCase) -> str:
    start, stop = _first_window(flown)
    most = float(np.nanmax(np.abs(flown.channel("phi")[flown.inside(start, stop)])))
    if most <= 30.0 * DEGREE + ALLOWANCE:
        return ""
    return f"judged up to {most / DEGREE:.3g} deg of bank, the window of the row ends at 30 deg"


def _check_height(feet: float) -> Callable[[FlownCase], str]:
    def check(flown: FlownCase) -> str:
        start, stop = _first_window(flown)
        height = np.interp([start, stop], flown.flight.time, flown.channel("h"))
        change = abs(float(height[1] - height[0])) / FOOT
        # a height is recorded to some feet
        if change >= 0.995 * feet:
            return ""
        return f"judged over {change:.0f} ft of height, the row has {feet:g} ft or more"

    return check


def _check_speed_change(flown: FlownCase) -> str:
    start, stop = _first_window(flown)
    speed = np.interp([start, stop], flown.flight.time, flown.channel("V_cas"))
    change = abs(float(speed[1] - speed[0])) / KNOT
    if change >= 0.995 * 50.0:
        return ""
    return f"judged over {change:.3g} kt of airspeed, the row has 50 kt or more"


def _check_engine_out(flown: FlownCase) -> str:
    for quantity in ("thrust", "torque"):
        names = sorted(name for name in flown.flight if _engine_number(name, quantity))
        if len(names) >= 2:
            break
    else:
        raise NotChecked("the record has neither thrust nor torque of two engines")
    power = [float(np.nanmean(flown.flight[name])) for name in names]
    if min(power) <= STOPPED_ENGINE * max(power):
        return ""
    share = 100.0 * min(power) / max(power)
    return (
        f"the weakest engine has {share:.0f} % of the {quantity} of the strongest, none has failed"
    )


def _engine_number(name: str, quantity: str) -> bool:
    """Return whether a channel is a quantity of one engine."""
    engine, _, last = name.rpartition(".")
    return last == quantity and engine.removeprefix("engine").isdigit()


def _check_runway(state: str) -> Callable[[FlownCase], str]:
    def check(flown: FlownCase) -> str:
        found = flown.case.drive.runway
        stated = file_facts(flown.case.aircraft)
        if not found and stated is not None:
            # a gear without a stated condition is on a dry runway
            found = stated.runway or "dry"
        if not found:
            raise NotChecked("drive.runway is not given")
        if found == state:
            return ""
        return f"the runway of the model is {found} (drive.runway), the row has a {state} one"

    return check


def _check_small_input(flown: FlownCase) -> str:
    name = _RATES[plain_id(flown.case.id)]
    start, stop = _first_window(flown)
    rate = flown.channel(name)[flown.inside(start, stop)]
    before = float(np.nanmean(rate[: max(1, rate.size // 10)]))
    most = float(np.nanmax(np.abs(rate - before))) / DEGREE
    if 0.95 * 0.5 <= most <= 1.05 * 2.0:
        return ""
    return f"the input gives {most:.3g} deg/s of {name}, the row has 0.5 to 2 deg/s"


def _check_turn(flown: FlownCase) -> str:
    instant = flown.case.events.get("capture")
    if instant is None:
        raise NotChecked("the event capture is not given")
    bank = abs(float(np.interp(instant, flown.flight.time, flown.channel("phi"))))
    most = 45.0
    if "delta_f" in flown.flight and flap_angle(flown) > FLAPS_OUT:
        most = 30.0
    if bank <= most * DEGREE + ALLOWANCE:
        return ""
    return f"{bank / DEGREE:.3g} deg of bank, the row goes up to {most:g} deg"


def _check_neutral(flown: FlownCase) -> str:
    time = flown.flight.time
    control = flown.channel("wheel", "delta_a")
    change = np.abs(control - control[0])
    most = float(np.nanmax(change))
    away = np.flatnonzero(change > BACK * most)
    if not away.size or away[-1] == time.size - 1:
        return "the roll control is not back at neutral in the window; the row has 10 s after it"
    after = float(time[-1] - time[away[-1]])
    if after >= 9.8:
        return ""
    return f"{after:.3g} s after the roll control is back at neutral, the row has 10 s"


def _check_pedal(flown: FlownCase) -> str:
    name, values = "delta_r", flown.channel("delta_r")
    change = float(np.nanmax(np.abs(values - values[0])))
    share = 100.0 * change / control_travel(flown.case, name)
    # the travel is known to some percent
    if 18.0 <= share <= 32.0:
        return ""
    return f"the rudder moves by {share:.0f} % of its travel, the row has 20 to 30 % of the pedal"


CHECKS: dict[str, Callable[[FlownCase], str]] = {
    "no_brakes": _check_no_brakes,
    "share_of_run": _check_share,
    "v1": _check_v1,
    "maximum_braking": _check_maximum_braking,
    "near_maximum_weight": _check_weight,
    "hands_off": _check_hands_off,
    "bank_below_30": _check_bank,
    "height_1000": _check_height(1000.0),
    "height_3000": _check_height(3000.0),
    "height_5000": _check_height(5000.0),
    "speed_change_50": _check_speed_change,
    "one_engine_out": _check_engine_out,
    "dry_runway": _check_runway("dry"),
    "wet_runway": _check_runway("wet"),
    "icy_runway": _check_runway("icy"),
    "small_input": _check_small_input,
    "bank_of_turn": _check_turn,
    "after_neutral": _check_neutral,
    "pedal_step": _check_pedal,
}
"""By condition: returns a text if it does not hold, and raises `NotChecked` if it is unknown."""
