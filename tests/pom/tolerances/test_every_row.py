"""All rows of the tolerance table: which can be judged, and that a right model passes and a
wrong one does not.

For every row a flight is made that has what its measure needs: channels, events, ranges.  The right
model is the flight itself; the wrong one answers at half speed, or is far off, or does not answer
at all.
"""

from collections import Counter

import numpy as np
import pytest

from flightmech.units import FOOT
from pom.cases.case import PomCase
from pom.cases.case_inputs import CaseInputs
from pom.cases.pilot import PilotLoop
from pom.judging.verdict import MEASURES, judge_criterion
from pom.tolerances import rows
from pom.tolerances.bands import remarks_text
from pom.tolerances.criteria import PARTS, Criterion
from pom.tolerances.rows import required_signals

TIME = np.arange(0.0, 120.001, 0.05)
_2016 = "2016-05-31 (Amdt 60-4)"
SHOWN = {
    ("FAA 14 CFR Part 60 App A Table A2A", _2016, "2.i", "demonstration"),
    ("FAA 14 CFR Part 60 App A Att 7", _2016, "7.B", "demonstration"),
    ("FAA FSTD Directive 2", _2016, "IV", "demonstration"),
}
"""Rows without a number and without a quantity: recordings that pilots judge.  All others can be
judged.
"""
ROWS_BY_PROVENANCE = {"verified": 269, "partial": 4, "memory": 53}
"""The only count of rows in the tests: a new row changes one number here."""

START, MIDDLE, END = 10.0, 40.0, 70.0


def ramp(low, high, start=START, stop=END):
    return low + (high - low) * np.clip((TIME - start) / (stop - start), 0.0, 1.0)


def sweep(slow=True):
    """Neutral, full one way, full the other way, neutral; the second half of the record is the
    rapid sweep.
    """
    turn = 2.0 * np.pi * np.clip((TIME - START) / 50.0, 0.0, 1.0)
    fast = 2.0 * np.pi * np.clip((TIME - 80.0) / 10.0, 0.0, 1.0)
    return np.sin(turn) + np.sin(fast)


def ringing():
    """A control released at 10 s: four overshoots beyond 5 %."""
    t = np.maximum(TIME - START, 0.0)
    return 0.1 * np.exp(-1.0 * t) * np.cos(6.0 * t) * (TIME <= 119.0)


def signals(criterion: Criterion) -> dict[str, np.ndarray]:
    """Return a flight in which the quantity of a criterion can be measured."""
    flat = np.ones_like(TIME)
    wave = 1.0 + 0.3 * np.sin(0.2 * TIME)
    found = dict.fromkeys(required_signals(criterion), wave)
    found |= {
        "V_cas": 80.0 - ramp(0.0, 60.0),
        "vn": 80.0 - ramp(0.0, 79.9),
        "ve": 0.0 * flat,
        "alpha": ramp(0.05, 0.3),
    }
    match criterion.measure:
        case "steady":
            found[criterion.channel] = flat
        case "change":
            found[criterion.channel] = ramp(0.1, 0.2, 20.0, 30.0)
        case "segment_mean" | "floor":
            down = criterion.parameter == "descent_rate" or "descent" in criterion.name
            found |= {
                "h": 3000.0 + (-1.0 if down else 1.0) * 20.0 * TIME,
                "V": 100.0 * flat,
                "V_cas": 80.0 * flat,
            }
        case "elapsed":
            rising = criterion.bounds[1] == "vr" or criterion.abscissa == "V_cas"
            found |= {
                "h": 20.0 * TIME,
                "fuel": 900.0 - 0.1 * TIME,
                "h_agl": 40.0 - ramp(0.0, 39.0, 1.0, 80.0),
            }
            found |= {"V_cas": ramp(0.0, 80.0, 5.0, 115.0), "vn": ramp(0.0, 80.0)} if rising else {}
        case "response_initial" | "response_total":
            found[criterion.channel] = ramp(1.0, 3.0)
        case "curve" | "breakout" | "force_increment" | "scalar" if (
            criterion.abscissa and criterion.parameter != "trim_rate"
        ):
            x = sweep()
            way = np.sign(np.gradient(x))
            size = 1e7 if criterion.channel == "p_brake" else 100.0
            found |= {
                criterion.abscissa: x,
                criterion.channel: size * (x + 0.2 * way + 0.1 * np.gradient(x, TIME)),
            }
        case "scalar":
            found |= {
                "psi": ramp(0.0, 6.0, 0.0, 120.0),
                "vn": 5.0 * flat,
                "delta_t": ramp(0.0, 0.2),
            }
        case "first_zero_crossing" | "period_n" | "overshoot_n" | "overshoot_count":
            found[criterion.channel] = ringing()
        case "time_90_to_10":
            found[criterion.channel] = 0.1 * np.exp(-np.maximum(TIME - START, 0.0))
        case "period" | "t_half" | "damping_ratio" | "peak_lag":
            ring = np.exp(-0.01 * TIME)
            found |= {
                name: 5.0 * ring * np.cos(0.5 * TIME + i)
                for i, name in enumerate((criterion.channel, "beta"))
            }
        case "vibration":
            tones = [np.sin(2.0 * np.pi * f * TIME) for f in (3.0, 5.5, 8.0)]
            found[criterion.channel] = 1.0 + 0.05 * sum(tones)
        case "event_value" | "setup":
            found |= {
                "stall_warning": (TIME > MIDDLE) * 1.0,
                "buffet": (TIME > MIDDLE) * 1.0,
                "h_agl": 40.0 - ramp(0.0, 39.0, 1.0, 80.0),
            }
    if "F_rim" in found:
        found["F_wheel"] = 0.2 * found.pop("F_rim")
    return found


MODES = ("vibration", "period", "peak_lag", "first_zero_crossing", "period_n", "time_90_to_10")


def wrong(criterion: Criterion, flight: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return a model that is far off in what the criterion measures."""
    model = {name: 0.4 * values for name, values in flight.items()}
    if criterion.measure in ("elapsed", "response_initial", "response_total", *MODES):
        late = START + 0.5 * (TIME - START)
        model = {
            name: np.interp(np.where(TIME > START, late, TIME), TIME, values)
            for name, values in flight.items()
        }
    elif criterion.measure in ("event_value", "setup"):
        model = flight | {criterion.channel: 3.0 * flight[criterion.channel]}
    elif criterion.measure == "floor":
        model = flight | {"h": 0.4 * flight["h"]}
    elif criterion.measure in ("t_half", "damping_ratio"):
        model = {name: values * np.exp(-0.05 * TIME) for name, values in flight.items()}
    elif criterion.measure in ("overshoot_n", "overshoot_count"):
        model = {name: 0.1 * np.exp(-np.maximum(TIME - START, 0.0)) for name in flight}
    elif criterion.measure in ("trace", "steady", "low_speed_end", "end_value"):
        model = {name: 50.0 * values + 1000.0 for name, values in flight.items()}
    elif criterion.measure in ("change", "scalar", "curve", "breakout", "force_increment"):
        kept = {"psi", "" if criterion.parameter == "trim_rate" else criterion.abscissa}
        model = {name: values if name in kept else 3.0 * values for name, values in flight.items()}
    return model


def case_of(row) -> tuple[PomCase, Criterion]:
    """Return a case that claims and marks what a row requires."""
    features = tuple(
        word for word in row["condition"].split(";") if word in rows.claimable_features()
    )
    times = {event: MIDDLE for event in rows.window_events()} | {
        "trim": 10.0,
        "capture": 60.0,
        "flare": 30.0,
        "touchdown": 60.0,
        "release": 10.0,
    }
    times |= {"static_sweep_start": 5.0, "static_sweep_end": 70.0, "stall": 55.0, "g_break": 50.0}
    for bound, time in ((row["applies_from"], START), (row["applies_to"], END)):
        event = bound.split("+")[0].split("-5s")[0]
        if event in times:
            times[event] = time
    times |= {
        "sweep_start": 75.0,
        "sweep_end": 118.0,
        "full_stop": END,
        "control_release": START,
        "input_end": START,
    }
    window = tuple(
        rows.bound_time(row[key], times, default)
        for key, default in (("applies_from", 0.0), ("applies_to", 120.0))
    )
    found = rows.make_criterion(row, "row", window, features, engine_parameter="engine1.n1")
    tabs = {"delta_t", "delta_tr"} & {found.channel, found.abscissa}
    level = (
        "pilot" if tabs else "force" if found.channel in ("column", "wheel", "pedal") else "cockpit"
    )
    engine = (
        "n1" if found.channel.endswith(".pla") else "throttle"
    )  # the angle of a lever that drives is not judged
    drive = CaseInputs(level, engine, pilot=tuple(PilotLoop(name, "q", 1.0, 0.1) for name in tabs))
    more = {"ranges": {}, "certified": {found.parameter: 0.1}, "conditions": {"wheel_radius": 0.2}}
    case = PomCase(
        "c",
        "C",
        row["test_id"],
        row["standard"],
        row["edition"],
        "c.toml",
        "r.nc",
        (0.0, 120.0),
        drive=drive,
        **more,
    )
    return PomCase(
        **{**case.__dict__, "events": times, "features": features, "criteria": (found,)}
    ), found


def key(row):
    return row["standard"], row["edition"], row["test_id"], row["parameter"]


ROWS = [row for row in rows.tolerance_rows() if key(row) not in SHOWN]
WITHOUT_NUMBER = {
    ("2.a.10", "column_force"),
    ("2.c.8.a", "column_force"),
    ("3.f.5", "normal_acceleration"),
}
"""Rows of the 2016 amendment whose number was not read."""


def test_only_rows_without_a_number_can_never_be_judged():
    never = {}
    for row in rows.tolerance_rows():
        _, found = case_of(row)
        assert found.applies, key(row)
        assert found.measure in MEASURES
        if found.reason:
            never[key(row)] = found.reason
    unread = {name for name, reason in never.items() if reason == rows.NUMBER_NOT_READ}
    assert {(test, parameter) for _, _, test, parameter in unread} == WITHOUT_NUMBER
    assert set(never) == unread
    shown = {key(row) for row in rows.tolerance_rows() if row["measure"] == "demonstration"}
    assert shown == SHOWN


@pytest.mark.nightly
def test_a_right_model_passes_every_row():
    count: Counter[str] = Counter()
    for row in ROWS:
        case, found = case_of(row)
        flight = signals(found)
        got = judge_criterion(case, found, TIME, flight, dict(flight))
        expected = "advisory" if found.measure in ("trend", "vibration") else "pass"
        if found.reason == rows.NUMBER_NOT_READ:
            expected = "not_tested"
        # a long run is not judged by the row for short ones
        if remarks_text(got.remarks).startswith("applies only with distance"):
            expected = "not_tested"
        assert got.verdict == expected, (
            key(row),
            found.measure,
            got.verdict,
            remarks_text(got.remarks),
        )
        count[got.verdict] += 1
    few = {"advisory": 8, "not_tested": 5}
    assert count == {"pass": len(ROWS) - sum(few.values()), **few}


@pytest.mark.nightly
def test_a_wrong_model_passes_none():
    for row in ROWS:
        case, found = case_of(row)
        flight = signals(found)
        got = judge_criterion(case, found, TIME, flight, wrong(found, flight))
        assert got.verdict != "pass", (key(row), found.measure, remarks_text(got.remarks))


@pytest.mark.nightly
@pytest.mark.parametrize("missing", ["channel", "event"])
def test_a_row_without_what_it_needs_states_what(missing):
    for row in ROWS:
        case, found = case_of(row)
        flight = signals(found)
        if missing == "channel":
            got = judge_criterion(case, found, TIME, {"nothing": TIME}, flight)
            assert got.verdict == "not_tested" or found.channel == "time", key(row)
            assert remarks_text(got.remarks)
        elif found.measure in ("event_value", "setup", "steady", "change") or set(
            found.condition.split(";")
        ) & set(PARTS):
            got = judge_criterion(
                PomCase(**{**case.__dict__, "events": {}}), found, TIME, flight, flight
            )
            reported = (
                "buffet" in remarks_text(got.remarks)
                or "stall_warning" in remarks_text(got.remarks)
                or "wow" in remarks_text(got.remarks)
            )
            assert "[events]" in remarks_text(got.remarks) or got.verdict == "pass" or reported, (
                key(row),
                remarks_text(got.remarks),
            )


@pytest.mark.slow
def test_memory_rows_carry_their_mark():
    marks = Counter(case_of(row)[1].provenance for row in rows.tolerance_rows())
    assert marks == ROWS_BY_PROVENANCE


def test_all_tolerances_of_the_table_are_symmetric():
    for item in rows.tolerance_rows():
        for low, high in (("lower", "upper"), ("alt_lower", "alt_upper")):
            if item[high]:
                assert float(item[low]) == -float(item[high])


def test_feet_are_exact():
    assert FOOT == 0.3048
