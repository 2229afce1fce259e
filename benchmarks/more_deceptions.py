"""Thirty further deceptions of an evaluator: case files, records and models changed one at a time.

    aeromatch demo -o out/t37
    python benchmarks/more_deceptions.py out/t37

`benchmarks/deceptions.py` looks for one word each.  Here the statuses and notices of the honest
case are those of comparison: a deception is named if its status differs from that pass,
or if a notice is there that the honest case does not have.  Printed: a line each.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
from deceptions import LAT, Bench, Deception, guided_answer, judge, scaled, shifted
from scipy.ndimage import gaussian_filter1d


def with_lines(b: Bench, name: str, lines: str) -> Deception:
    """A case with further lines in [conditions]."""
    return Deception([b.case(name, (LAT, f"{LAT}\n{lines}"))], b.final)


def with_edit(b: Bench, name: str, *edits: tuple[str, str], more: str = "") -> Deception:
    return Deception([b.case(name, *edits, more=more)], b.final)


def with_record(b: Bench, name: str, change, model: Path | None = None) -> Deception:
    return Deception([b.case(name, record=b.record(name, change))], model or b.final)


def added(amounts: dict[str, float]):
    return lambda channel, clock, values: values + amounts[channel] if channel in amounts else None


def smoothed(seconds: float):
    """Every motion channel, smoothed: overshoots and noise of the flight become smaller."""
    names = ("p", "q", "r", "phi", "theta", "psi", "ax_imu", "ay_imu", "az_imu")

    def change(channel, clock, values):
        step = float(np.median(np.diff(clock))) if clock.size > 1 else 1.0
        return gaussian_filter1d(values, seconds / step) if channel in names else None

    return change


def slower_clock(factor: float):
    """Every channel, as if the clock of the recorder ran wrong by a factor."""
    return lambda channel, clock, values: np.interp(
        clock[0] + (clock - clock[0]) / factor, clock, values
    )


def swapped_axes(b: Bench) -> Deception:
    """Yaw and pitch rate exchanged in the record."""
    pair: dict[str, np.ndarray] = {}

    def keep(channel, clock, values):
        pair[channel] = values
        return None

    b.record("27", keep)
    exchanged = {"q": pair["r"], "r": pair["q"]}
    return with_record(b, "27", lambda channel, clock, values: exchanged.get(channel))


def mirrored_flight(b: Bench) -> Deception:
    """One Dutch roll shown twice, the second time with left and right exchanged."""
    sides = ("p", "r", "phi", "ay_imu", "beta_vane", "delta_r", "ve", "east")

    def mirror(channel, clock, values):
        if channel == "psi":
            return values[0] - (values - values[0])
        pair = {"delta_a_left": -1.0, "delta_a_right": -1.0}
        return values * -1.0 if channel in sides or channel in pair else None

    again = b.case("27", ('name = "dutch_roll"', 'name = "again"'), record=b.record("27", mirror))
    return Deception([b.case("27"), again], b.final)


def flight_of_other_test(b: Bench) -> Deception:
    """The record of one test shows another one, smoothed and on another clock."""
    (record,) = (b.window_of("27", 1.0, 28.4, 60.0),)
    edits = (
        ('name = "dutch_roll"', 'name = "rudder"'),
        ('id = "2.d.7"', 'id = "2.d.6"'),
        ("window = [5.5, 28.2]", "window = [65.5, 88.2]"),
        ("input_end = 8.6", "input_end = 68.6"),
    )
    return Deception([b.case("27"), b.case("27", *edits, record=record)], b.final)


def few_channels_shown(b: Bench) -> Deception:
    """An answer that follows the smoothed record, in a case that shows hardly any channel."""
    guided = guided_answer(b)
    guided.cases = [b.case("26", ('title = "', 'show = ["alpha"]\ntitle = "'))]
    return guided


def unseen_airspeed(b: Bench) -> Deception:
    """A model with half the drag, in a case that shows neither airspeed nor height."""
    case = b.case("21", ('title = "', 'show = ["alpha"]\ntitle = "'))
    return Deception([case], b.spoilt(CD__basic=0.3))


def lines_of_a_pilot(control: str, channel: str, gain: str) -> str:
    loop = f'control = "{control}"\nchannel = "{channel}"\ngain = "{gain}"\nlimit = "5 deg"'
    return f"[[drive.pilot]]\n{loop}"


PILOTED = ('surfaces = "recorded"', 'surfaces = "pilot"')
SLOW = "Cm__qhat"

# name of the deception: (honest case, what makes it)
DECEPTIONS = {
    # case files
    "alpha_of_the_case": ("21", lambda b: with_lines(b, "21", 'alpha = "9 deg"')),
    "pitch_rate_of_the_case": ("21", lambda b: with_lines(b, "21", 'q = "1 deg/s"')),
    "height_of_the_case": ("26", lambda b: with_lines(b, "26", 'h = "3000 m"')),
    "wind_of_the_case": ("29", lambda b: with_lines(b, "29", 'wind_d = "-1 m/s"')),
    "inertia_of_the_case": ("21", lambda b: with_lines(b, "21", "Iyy = 5000")),
    "elevator_of_the_case": ("22", lambda b: with_lines(b, "22", 'delta_e = "-2 deg"')),
    "flaps_of_the_case": ("26", lambda b: with_lines(b, "26", 'delta_f = "10 deg"')),
    "late_window": ("27", lambda b: with_edit(b, "27", ("[5.5, 28.2]", "[12.0, 28.2]"))),
    "late_end_of_the_input": ("27", lambda b: with_edit(b, "27", ("= 8.6", "= 15.0"))),
    "early_end_of_the_input": ("26", lambda b: with_edit(b, "26", ("= 12.0", "= 6.0"))),
    "tolerance_in_radians": (
        "21",
        lambda b: with_edit(b, "21", more='[tolerance]\npitch_angle = "1.5 rad"'),
    ),
    "pilot_holds_a_judged_channel": (
        "21",
        lambda b: with_edit(
            b, "21", PILOTED, more=lines_of_a_pilot("delta_e", "theta", "0.5 deg/deg")
        ),
    ),
    "pilot_holds_a_rate": (
        "21",
        lambda b: with_edit(b, "21", PILOTED, more=lines_of_a_pilot("delta_e", "q", "1 s")),
    ),
    "pilot_in_a_free_response": (
        "26",
        lambda b: with_edit(
            b, "26", PILOTED, more=lines_of_a_pilot("delta_e", "alpha", "-0.3 deg/deg")
        ),
    ),
    "calm_air": ("25", lambda b: with_edit(b, "25", ("trim = ", 'wind = "none"\ntrim = '))),
    "device_called_absent": (
        "29",
        lambda b: with_edit(b, "29", ('title = "', 'absent = ["altitude"]\ntitle = "')),
    ),
    # records
    "mass_wrong_by_4_percent": ("21", lambda b: with_record(b, "21", scaled("mass", 1.04))),
    "centre_of_gravity_of_the_record": (
        "21",
        lambda b: with_record(b, "21", added({"x_cg": 0.06})),
    ),
    "swapped_axes": ("27", swapped_axes),
    "smoothed_record": ("27", lambda b: with_record(b, "27", smoothed(0.35))),
    "slow_clock": ("27", lambda b: with_record(b, "27", slower_clock(1.04))),
    "thrust_wrong_by_15_percent": (
        "29",
        lambda b: with_record(
            b, "29", lambda c, t, v: v * 1.15 if c.startswith("thrust") else None
        ),
    ),
    "angle_of_attack_off": ("26", lambda b: with_record(b, "26", added({"alpha_vane": 0.035}))),
    "pitch_angle_off": ("26", lambda b: with_record(b, "26", added({"theta": 0.035}))),
    "height_off": ("27", lambda b: with_record(b, "27", added({"p_static": -6000.0}))),
    "elevator_off": ("26", lambda b: with_record(b, "26", added({"delta_e": 0.02}))),
    "airspeed_off": (
        "26",
        lambda b: with_record(
            b, "26", lambda c, t, v: v * 1.05 if c in ("V_cas", "V_tas") else None
        ),
    ),
    "late_rates": ("22", lambda b: with_record(b, "22", shifted(("p", "phi"), 0.15))),
    "mirrored_flight": ("27", mirrored_flight),
    "flight_of_another_test": ("27", flight_of_other_test),
    # models
    "few_channels_shown": ("26", few_channels_shown),
    "unseen_airspeed": ("21", unseen_airspeed),
    "inertia_of_the_model": (
        "21",
        lambda b: Deception(
            [b.case("21")], b.spoilt(lambda craft: replace(craft, Iyy=1.12 * craft.Iyy))
        ),
    ),
    "mass_of_the_model": (
        "22",
        lambda b: Deception(
            [b.case("22")], b.spoilt(lambda craft: replace(craft, mass=1.2 * craft.mass))
        ),
    ),
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("demo", type=Path, help="output folder of aeromatch demo")
    parser.add_argument("--only", default="", help="part of the name of a deception")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    honest: dict[str, tuple[list[str], set[str]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        b = Bench(given.demo.resolve(), Path(folder), np.random.default_rng(1))
        chosen = {name: item for name, item in DECEPTIONS.items() if given.only in name}
        named = 0
        for name, (case, make) in chosen.items():
            start = time.perf_counter()
            if case not in honest:
                statuses, text = judge(Deception([b.case(case)], b.final))
                honest[case] = statuses, set(text.splitlines())
            statuses, text = judge(make(b))
            new = [line for line in text.splitlines() if line not in honest[case][1]]
            # the name of a second case and its status are lines, too
            new = [line for line in new if " " in line]
            is_named = bool(new) or statuses[-1] != honest[case][0][-1]
            named += is_named
            state = "named " if is_named else "SILENT"
            seconds = time.perf_counter() - start
            print(f"{state} {name:32} {', '.join(statuses):44} {seconds:4.0f} s")
            print(f"       {' | '.join(new)[:220]}", flush=True)
        print(f"{named} of {len(chosen)} named")


if __name__ == "__main__":
    main()
