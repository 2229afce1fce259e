"""Whether the aeroplane responds to its controls with the signs of the vocabulary, and by how much.

Kinematics do not show the sign of a surface; the aeroplane does.  Angular accelerations are
regressed on rates, flow angles and surfaces, all high-passed so that trim and slow drift have no
part in it.  Positive elevator pitches down, positive aileron rolls left, positive rudder yaws left;
side force opposes sideslip; the surface follows the pilot's hand.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import astuple, dataclass, replace
from itertools import combinations

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.signals import (
    BAND,
    ResampledChannels,
    lowpass_if_possible,
)
from flighttest.reconstruction.quality.checks.surface_timing import (
    LONGEST,
    SurfaceTiming,
    regress_last_column,
    surface_timing,
)
from flighttest.reconstruction.quality.finding import (
    Finding,
    add_delay_line,
    iterate_rows,
    map_entry,
)
from flighttest.records.signals.differentiation import derivative

SIGNIFICANT = 6.0  # standard errors a coefficient must have before its sign counts
FOLLOWS = 0.5  # correlation of a surface with the hand that moves it
_AMBIGUOUS = 0.1  # by which the other sign must correlate better at some delay
_TRIM = 0.3  # Hz, below which nothing counts
_LOWEST_R2 = 0.15
_EARLY, _LATE = 0.05, -0.15  # s beyond which a surface was not recorded when it acted
_GAINS, _SHARE = (
    0.003,
    0.05,
)  # of R2, and of what is unexplained without it, that the time must gain
_CERTAIN = 3.0  # standard errors by which the time must lie beyond
_ACTIVE, _AROUND = (
    0.25,
    1.5,
)  # of the largest movement, and s around it: samples that show when a surface acts
_MOVED = 1.0 * DEGREE  # total movement without which a delay is not informative
_EFFECT = ("surface", "rate", "effect", "stderr", "ratio", "R2", "movement")
_TIMING = ("lead", "lead_stderr", "gained", "explained", "bound", "sign", "other")
_FLOW_DELAYS = np.arange(
    0.1, 3.05, 0.1
)  # s that a flow angle may be late where a surface looks reversed
_LESS = 0.8  # of what is unexplained must then be left
_FLOW = {"alpha_vane", "beta_vane"}
_EXPLAINED = 0.4  # R2 that the equation must reach about the movements with the best delay
_MOVES = 0.05 * DEGREE  # rms of quick movement that makes an input
_SMALL = 0.6 * DEGREE  # total movement below which an effect must not be large
_STRONGEST = {
    "delta_e": 100.0,
    "delta_a": 100.0,
    "delta_r": 20.0,
}  # 1/s2 per radian at the mean speed of the record
_WORDS = {
    "delta_e": "pitches the nose up (convention: trailing edge down is positive and pitches down)",
    "delta_a": "rolls to the right (convention: right aileron down is positive and rolls left)",
    "delta_r": "yaws to the right (convention: trailing edge left is positive and yaws left)",
}


@dataclass(frozen=True)
class Equation:
    """One answer of the aeroplane: what is explained, and by what."""

    rate: str
    others: tuple[str, ...]
    surface: str


EQUATIONS = (
    Equation("q", ("q", "alpha_vane"), "delta_e"),
    Equation("p", ("p", "r", "beta_vane", "delta_r"), "delta_a"),
    Equation("r", ("p", "r", "beta_vane", "delta_a"), "delta_r"),
)
HANDS = (  # pilot's control, what it moves, sign of the vocabulary, whether it is a position
    ("column", "delta_e", -1, True),
    ("wheel", "delta_a", -1, True),
    ("pedal", "delta_r", -1, True),
    ("F_column", "delta_e", -1, False),
    ("F_wheel", "delta_a", -1, False),
    ("F_pedal", "delta_r", -1, False),
)


def control_responses(signals: ResampledChannels) -> pd.DataFrame:
    """Return how the aeroplane answers each surface.

    Parameters
    ----------
    signals : Signals
        With right signs and units of rates and flow angles.

    Returns
    -------
    DataFrame
        One row per surface that moves: ``surface rate effect stderr ratio R2 movement lead
        lead_stderr gained explained bound sign other flow_late``; effect is the angular acceleration per
        radian at the mean dynamic pressure of the flight [s-2], with the surface at the time at
        which it acts, stderr that of coloured residuals, movement the range between 0.5 and 99.5 %
        [rad].  Lead is the time by which the surface is recorded before it acts and lead_stderr its
        standard error [s], infinite where it lies at the end of the search (bound); gained the R2
        that delaying it gains, explained the R2 with that delay, both about the movements of the
        surface.  Sign is that of the effect, 0 where the other sign with the lead `other` [s]
        explains the motion as well: see `surface_timing`.  Where the surface looks reversed, flow_late
        is the delay of the flow angle with which it does not [s]; else 0.

    Notes
    -----
    Only samples about the movements of a surface show when it acts.  In all others, of which a flight has more, a delayed surface
    makes up for what else the equation lacks: a vane on the wing in a roll is enough for a delay of 0.2 s.
    """
    found: dict[Equation, tuple] = {}
    rest = list(EQUATIONS)
    while rest:
        tried = {
            equation: row for equation in rest if (row := _answer(equation, signals)) is not None
        }
        displaced = {equation: row for equation, (row, clear) in tried.items() if clear > 0.0}
        if not displaced:
            found.update({equation: row for equation, (row, _) in tried.items()})
            break
        # a surface at another time spoils the equations that read it: the clearest one is put where
        # it acts, and the others follow
        clearest = max(displaced, key=lambda equation: tried[equation][1])
        found[clearest] = displaced[clearest]
        lead = found[clearest][len(_EFFECT)]
        signals = signals.with_values(
            {
                clearest.surface: np.interp(
                    signals.time - lead, signals.time, signals[clearest.surface]
                )
            }
        )
        rest = [equation for equation in tried if equation != clearest]
    return pd.DataFrame(
        [found[equation] for equation in EQUATIONS if equation in found],
        columns=[*_EFFECT, *_TIMING, "flow_late"],
    )


def _answer(equation: Equation, signals: ResampledChannels) -> tuple[tuple, float] | None:
    """Return a row of `control_responses`, and how clearly the surface is displaced in time; None where a
    channel or its movement is missing.
    """
    if not {equation.rate, equation.surface} <= set(signals.values):
        return None
    others = [name for name in equation.others if name in signals and np.ptp(signals[name]) > 0.0]
    mask = signals.mask((equation.rate, *others, equation.surface))
    x = signals[equation.surface][mask]
    if (
        mask.sum() * signals.step < 5.0
        or np.ptp(x) == 0.0
        or np.ptp(signals[equation.rate][mask]) == 0.0
    ):
        return None
    scale = _pressure(signals, mask)
    y = _fast(derivative(_slow(signals, equation.rate), signals.step, 5, 2) / scale, signals)
    columns = [
        _fast(_slow(signals, n) / (np.sqrt(scale) if n in "pqr" else 1.0), signals) for n in others
    ]
    surface = _fast(_slow(signals, equation.surface), signals)
    movement = float(np.percentile(x, 99.5) - np.percentile(x, 0.5))
    active = mask & _about_movements(surface, mask, signals.step)
    active = active if active.sum() > 10 * (len(columns) + 1) else mask
    timing = surface_timing(
        y[active], [column[active] for column in columns], surface, signals.time, active
    )
    # the effect is that at the time at which the surface acts, where the record shows another one
    # than its clock does
    # without its flow angle the equation lacks the response to it, which a delay of the surface
    # takes up
    complete = not (set(equation.others) & _FLOW) - set(others)
    displaced = complete and _is_displaced(timing, movement)
    acting = np.interp(signals.time - timing.lead, signals.time, surface) if displaced else surface
    fit = regress_last_column(
        y[mask], [*(column[mask] for column in columns), acting[mask]], mask, signals.step
    )
    if fit is None:
        return None
    effect, stderr, R2 = fit
    if not complete and np.sign(effect) != timing.sign:
        timing = replace(timing, sign=0)
    flow_late = 0.0
    if effect > 0.0 and complete:
        left = _LESS * (1.0 - timing.explained)
        flow_late = _flow_delay(y, others, columns, surface, (signals.time, active), left)
    row = (
        equation.surface,
        equation.rate,
        effect,
        stderr,
        effect / max(stderr, 1e-300),
        R2,
        movement,
        *astuple(timing),
        flow_late,
    )
    return row, timing.gained / max(1.0 - timing.explained, 1e-12) if displaced else 0.0


def _flow_delay(
    y: np.ndarray,
    others: list[str],
    columns: list[np.ndarray],
    surface: np.ndarray,
    place: tuple[np.ndarray, np.ndarray],
    most: float,
) -> float:
    """Return the delay of the flow angles with which a surface that looks reversed acts as the
    convention states and less than `most` of the variance is left; 0 without one. [s]
    """
    time, active = place
    found = 0.0
    for delay in _FLOW_DELAYS:
        moved = [
            np.interp(time + delay, time, column) if name in _FLOW else column
            for name, column in zip(others, columns, strict=True)
        ]
        X = np.stack([column[active] for column in (*moved, surface)], axis=1)
        theta = np.linalg.lstsq(X, y[active], rcond=1e-10)[0]
        left = float(np.var(y[active] - X @ theta) / max(np.var(y[active]), 1e-300))
        if theta[-1] < 0.0 and left < most:
            found, most = float(delay), left
    return found


def _about_movements(surface: np.ndarray, mask: np.ndarray, step: float) -> np.ndarray:
    """Return the samples about the larger quick movements of a surface."""
    large = np.abs(surface) > _ACTIVE * np.percentile(np.abs(surface[mask]), 99.5)
    width = 2 * min(round(_AROUND / step), (len(large) - 1) // 2) + 1
    return np.convolve(large, np.ones(width), mode="same") > 0.5


def _is_displaced(timing: SurfaceTiming, movement: float) -> bool:
    """Return whether a surface was certainly not recorded when it acted."""
    margin = 0.0 if timing.bound else _CERTAIN * timing.stderr
    off = timing.lead - margin > _EARLY or timing.lead + margin < _LATE
    gains = timing.gained > max(_GAINS, _SHARE * (1.0 - timing.explained + timing.gained))
    return (
        timing.sign != 0 and off and gains and movement > _MOVED and timing.explained > _EXPLAINED
    )


def pilot_to_surface(signals: ResampledChannels) -> pd.DataFrame:
    """Return how each surface follows the pilot's control: ``control surface expected correlation
    delay position``.

    The correlation is the largest within two seconds of delay, and `delay` [s] is that by which the
    surface is recorded after the control; the expected sign is kept where it correlates nearly as
    well, because half a period of delay looks like the opposite sign.
    """
    table: list = []
    for control, surface, sign, position in HANDS:
        if {control, surface} <= set(signals.values):
            mask = signals.mask((control, surface))
            x, y = (_fast(_slow(signals, name), signals) for name in (control, surface))
            if mask.sum() * signals.step > 5.0 and np.std(y[mask]) > _MOVES:
                table.append(
                    (control, surface, sign, *_followed(x, y, sign, mask, signals.step), position)
                )
    return pd.DataFrame(
        table, columns=["control", "surface", "expected", "correlation", "delay", "position"]
    )


def _followed(
    x: np.ndarray, y: np.ndarray, expected: int, mask: np.ndarray, step: float
) -> tuple[float, float]:
    """Return the correlation of a surface y with a control x, and the delay of the surface at which
    it is reached.
    """
    delays = np.arange(-round(LONGEST / step), round(LONGEST / step) + 1)
    found = []
    for k in delays:
        moved = np.roll(x, k)[mask]  # what comes in at the ends is high-passed, and small
        found.append(float(np.corrcoef(moved, y[mask])[0, 1]) if np.std(moved) > 0.0 else 0.0)
    right, wrong = (int(np.argmax(sign * np.array(found))) for sign in (expected, -expected))
    at = (
        right
        if abs(found[right]) > abs(found[wrong]) - _AMBIGUOUS and found[right] * expected > FOLLOWS
        else wrong
    )
    if abs(found[at]) < FOLLOWS:  # nothing follows at any delay
        at = right
    return found[at], float(delays[at] * step)


def answer_findings(
    table: pd.DataFrame,
    followed: pd.DataFrame,
    signals: ResampledChannels,
    record: xr.DataTree,
    late: Collection[str] = (),
) -> list[Finding]:
    """Return the surfaces that move the aeroplane the wrong way, far too much or at another time,
    and the controls that nothing follows.

    Channels that are `late` themselves show nothing about the time of a surface, nor does an
    equation without its flow angle.
    """
    found = []
    for row in iterate_rows(table):
        others = _others_of(row.surface)
        complete, untimely = (
            not (set(others) & _FLOW) - set(signals.values),
            set(others) & set(late),
        )
        timed = complete and not untimely and row.flow_late == 0.0
        seen = row.R2 >= _LOWEST_R2 and abs(row.ratio) >= SIGNIFICANT
        wrong = _surface(row, record, not untimely) if seen else []
        found += wrong
        if timed and all(finding.kind == "sign" for finding in wrong):
            found += _timing(row, record, -1.0 if wrong else 1.0)
    for row in iterate_rows(followed):
        found += _hand(row, record)
    return found + _side_force(signals)


def _surface(row, record: xr.DataTree, timed: bool) -> list[Finding]:
    """Return whether the sign or the unit of a surface is wrong; where a delay explains as much as
    a sign, neither is called wrong.
    """
    name, names = row.surface, (row.surface, row.rate)
    evidence = {"effect": row.effect, "stderr": row.stderr, "R2": row.R2}
    flow = next((other for other in _others_of(name) if other in _FLOW), "")
    measured = (
        f"{row.rate}_dot = {row.effect:+.3g} 1/s2 per rad of {name}, {abs(row.ratio):.0f} "
        f"standard errors"
    )
    if row.effect > 0.0 and row.flow_late > 0.0 and row.movement > _MOVED:
        late = f"{1e3 * row.flow_late:.0f} ms"
        text = (
            f"{flow} is recorded about {late} late, or {name} has the wrong sign: with that "
            f"delay {name} moves the aeroplane as the "
            f"convention states and more of {row.rate}_dot is explained than at any other "
            f"time of {name}; without it {measured}"
        )
        remedy = (
            f"compare {flow} with attitude and climb, or with another record; "
            f"{add_delay_line(record, flow, delay=row.flow_late)}"
        )
        return [
            Finding(
                "warning",
                "lag",
                (flow, name, row.rate),
                text,
                remedy,
                evidence={**evidence, "flow_late": row.flow_late},
            )
        ]
    if row.effect > 0.0 and row.sign > 0:
        tried = f"no delay up to {LONGEST:g} s explains as much"
        text = f"{name} has the wrong sign: positive {name} {_WORDS[name]}; {measured}; {tried}"
        return [
            Finding("error", "sign", names, text, map_entry(record, name, -1.0), evidence=evidence)
        ]
    if row.effect > 0.0 and row.sign == 0 and timed and row.movement > _MOVED:
        first, second = sorted((row.lead, row.other), key=abs)
        text = (
            f"{name} has the wrong sign or is recorded at another time: {measured}; recorded "
            f"{_when(first)} with one sign or "
            f"{_when(second)} with the other it explains the motion equally well"
        )
        remedy = (
            f"compare {name} with the pilot's control or with a record that holds a "
            f"3-2-1-1, then correct sign or delay in the name map"
        )
        return [
            Finding(
                "warning",
                "undecided",
                names,
                text,
                remedy,
                evidence={**evidence, "lead": row.lead, "other": row.other},
            )
        ]
    if row.effect < 0.0 and row.movement < _SMALL and abs(row.effect) > _STRONGEST[name]:
        text = (
            f"{name} is in rad and was taken as deg: it moves by {row.movement / DEGREE:.2g} "
            f"deg in all, and {measured}"
        )
        return [
            Finding(
                "error",
                "unit",
                names,
                text,
                map_entry(record, name, 1.0 / DEGREE),
                evidence=evidence,
            )
        ]
    return []


def _others_of(surface: str) -> tuple[str, ...]:
    return next(equation.others for equation in EQUATIONS if equation.surface == surface)


def _when(lead: float) -> str:
    return f"{1e3 * abs(lead):.0f} ms {'early' if lead > 0.0 else 'late'}"


def _timing(row, record: xr.DataTree, slope: float) -> list[Finding]:
    """Return whether a surface was recorded when it acted; `slope` is -1 where its sign is to be
    corrected in the same line.
    """
    name, names = row.surface, (row.surface, row.rate)
    timing = SurfaceTiming(
        row.lead, row.lead_stderr, row.gained, row.explained, row.bound, row.sign, row.other
    )
    if not _is_displaced(timing, row.movement):
        return []
    early = row.lead > 0.0
    measured = f"{1e3 * abs(row.lead):.0f} ms"
    measured = (
        f"at least {measured}"
        if row.bound
        else f"{measured} (standard error {1e3 * row.lead_stderr:.0f} ms)"
    )
    end = f"; longer times than {LONGEST:g} s were not tried" if row.bound else ""
    text = (
        f"{name} is recorded {measured} {'before' if early else 'after'} it acts on {row.rate}_dot "
        f"(that time gains {row.gained:.2f} of R2, which is then {row.explained:.2f}{end})"
    )
    cause = "a command, whose actuator lags" if early else "a clock that is late"
    line = (
        ""
        if row.bound
        else add_delay_line(record, name, **{"lag" if early else "delay": -row.lead}, slope=slope)
    )
    remedy = (
        f"{line}, if it is {cause}"
        if line
        else f"{cause}: find the time between and put it into the name map"
    )
    evidence = {
        "lead": row.lead,
        "stderr": None if row.bound else row.lead_stderr,
        "gained": row.gained,
        "bound": bool(row.bound),
    }
    return [Finding("warning", "lag", names, text, remedy, evidence=evidence)]


def _hand(row, record: xr.DataTree) -> list[Finding]:
    names, evidence = (
        (row.control, row.surface),
        {"correlation": row.correlation, "delay": row.delay},
    )
    detail = f"(correlation {row.correlation:+.2f}, {1e3 * row.delay:+.0f} ms)"
    if row.expected * row.correlation < -FOLLOWS:
        text = (
            f"{row.control} has the wrong sign: it moves with {row.surface} instead of "
            f"against it {detail}"
        )
        return [
            Finding(
                "error",
                "sign",
                names,
                text,
                map_entry(record, row.control, -1.0),
                evidence=evidence,
            )
        ]
    if row.position and abs(row.correlation) < FOLLOWS:
        text = f"{row.surface} moves and {row.control} does not go with it {detail}"
        return [
            Finding(
                "warning",
                "stuck",
                names,
                text,
                "check the pick-up; do not use the channel",
                evidence=evidence,
            )
        ]
    return []


def _side_force(signals: ResampledChannels) -> list[Finding]:
    """Side force opposes sideslip, whatever the aeroplane."""
    if not {"ay_imu", "beta_vane"} <= set(signals.values):
        return []
    mask = signals.mask(("ay_imu", "beta_vane"))
    if mask.sum() * signals.step < 5.0 or np.std(signals["beta_vane"][mask]) < 0.5 * DEGREE:
        return []
    scale = _pressure(signals, mask)
    names = [name for name in ("p", "r", "delta_r") if name in signals]
    others = [_fast(_slow(signals, name), signals)[mask] for name in names]
    y, slip = _fast(signals["ay_imu"] / scale, signals)[mask], _fast(signals["beta_vane"], signals)
    fit = regress_last_column(y, [*others, slip[mask]], mask, signals.step)
    if fit is None or fit[2] < _LOWEST_R2 or fit[0] / fit[1] < SIGNIFICANT:
        return []
    if surface_timing(y, others, slip, signals.time, mask).sign <= 0:  # a late vane looks reversed
        return []
    effect, stderr, R2 = fit
    detail = f"{effect:+.3g} m/s2 per rad, {effect / stderr:.0f} standard errors"
    text = f"ay_imu grows with beta_vane ({detail}): side force must oppose sideslip"
    remedy = "sign = -1 on one of the two; the check of kinematics shows which"
    return [
        Finding(
            "error",
            "sign",
            ("ay_imu", "beta_vane"),
            text,
            remedy,
            evidence={"effect": effect, "stderr": stderr, "R2": R2},
        )
    ]


def _slow(signals: ResampledChannels, name: str) -> np.ndarray:
    return lowpass_if_possible(signals[name], signals.step, BAND)


def _fast(x: np.ndarray, signals: ResampledChannels) -> np.ndarray:
    return x - lowpass_if_possible(x, signals.step, _TRIM)


def _pressure(signals: ResampledChannels, mask: np.ndarray) -> np.ndarray:
    """Dynamic pressure over its mean, from the speed; one where no speed is recorded."""
    speed = next((name for name in ("V", "V_cas") if name in signals), None)
    if speed is None:
        return np.ones_like(signals.time)
    V2 = np.maximum(signals[speed], 0.3 * np.median(signals[speed][mask])) ** 2
    return V2 / V2[mask].mean()


COLLINEAR = 0.9  # correlation of two inputs, or multiple correlation of one with the others
_TRIM_BAND = 0.05  # Hz, slower than any manoeuvre
_AXES = (("pitch", "delta_e", "q"), ("roll", "delta_a", "p"), ("yaw", "delta_r", "r"))
_INPUT, _RATE = (
    0.25 * DEGREE,
    0.4 * DEGREE,
)  # rms over a second that count as movement: surface [rad], rate [rad s-1]
_LEVER = 0.02
_SECOND = 1.0  # s
_CONTROLS = {"elevator": "delta_e", "aileron": "delta_a", "rudder": "delta_r"}
_INPUTS = ("delta_e", "delta_a", "delta_r", "delta_s", "delta_d", "throttle")


def axis_excitation(signals: ResampledChannels) -> pd.DataFrame:
    """Return what moved about each axis.

    Returns
    -------
    DataFrame
        ``axis surface rate input response share frequency``: largest rms over one second of surface
        [rad] and rate [rad s-1] without trim and slow drift, share of the flight in which both move
        [1], frequency below which nine tenths of the surface's movement lie [Hz].
    """
    table: list = []
    for axis, surface, rate in _AXES:
        if not {surface, rate} <= set(signals.values):
            continue
        mask = signals.mask((surface, rate))
        if not mask.any():
            continue
        moved = [_quick(signals, name) for name in (surface, rate)]
        x, y = (_rms(part, signals.step)[mask] for part in moved)
        share = float(np.mean((_held(x > _INPUT, signals.step)) & (y > _RATE)))
        table.append(
            (
                axis,
                surface,
                rate,
                float(x.max()),
                float(y.max()),
                share,
                _frequency(moved[0][mask], signals.step),
            )
        )
    return pd.DataFrame(
        table, columns=["axis", "surface", "rate", "input", "response", "share", "frequency"]
    )


def input_correlations(signals: ResampledChannels) -> pd.DataFrame:
    """Return the correlation of the inputs that move, without trim; the throttles count as one."""
    columns, mask = _inputs(signals)
    if len(columns) < 2:
        return pd.DataFrame()
    return pd.DataFrame(
        np.corrcoef([x[mask] for x in columns.values()]), index=list(columns), columns=list(columns)
    )


def excitation_findings(
    table: pd.DataFrame,
    matrix: pd.DataFrame,
    signals: ResampledChannels,
    flown: pd.DataFrame,
    purpose: str,
) -> list[Finding]:
    """Return what was not excited, manoeuvres whose control did not move, and inputs that moved
    together.

    Parameters
    ----------
    table, matrix : DataFrame
        Of `excitation` and `input_correlations`.
    signals : Signals
    flown : DataFrame
        Of `flighttest.manoeuvres`.
    purpose : str
        ``validation`` records need no excitation.
    """
    found = _unexcited(table, purpose)
    for row in iterate_rows(flown):
        found += _unflown(row, signals)
    return found + _collinear(matrix)


def _unexcited(table: pd.DataFrame, purpose: str) -> list[Finding]:
    still = [row for row in iterate_rows(table) if row.share == 0.0]
    if not still:
        return []
    needed = len(still) == len(table) and purpose != "validation"
    text = "{0.axis}: {0.surface} moves by {1:.2g} deg rms, {0.rate} by {2:.2g} deg/s"
    what = "; ".join(text.format(row, row.input / DEGREE, row.response / DEGREE) for row in still)
    head = (
        "no axis is excited"
        if len(still) == len(table)
        else f"not excited: {', '.join(row.axis for row in still)}"
    )
    text = f"{head} ({what})"
    remedy = (
        "no derivative of these axes can be identified from this record; fly doublets, "
        "3-2-1-1 or multisines"
    )
    return [
        Finding(
            "warning" if needed else "note",
            "excitation",
            tuple(row.surface for row in still),
            text,
            remedy,
        )
    ]


def _unflown(row, signals: ResampledChannels) -> list[Finding]:
    """A manoeuvre whose control does not move was not flown there."""
    found = []
    for word in str(row.control).split():
        name = _CONTROLS.get(word, word)
        if name not in signals or name not in _CONTROLS.values():
            continue
        inside = (signals.time >= row.start) & (signals.time <= row.end)
        movement = (
            float(np.ptp(signals[name][inside])) if inside.sum() * signals.step > 1.0 else np.inf
        )
        if movement < 2.0 * _INPUT:
            text = (
                f"{row.manoeuvre} at {row.start:g} ... {row.end:g} s: {name} moves by "
                f"{movement / DEGREE:.2g} deg only"
            )
            remedy = "check the times of the list of manoeuvres, and the pick-up"
            found.append(
                Finding(
                    "warning", "excitation", (name,), text, remedy, float(row.start), float(row.end)
                )
            )
    return found


def _collinear(matrix: pd.DataFrame) -> list[Finding]:
    found, paired = [], set()
    names, values = [str(name) for name in matrix.columns], matrix.to_numpy()
    for (i, one), (j, other) in combinations(enumerate(names), 2):
        correlation = float(values[i, j])
        if abs(correlation) > COLLINEAR:
            paired |= {one, other}
            text = (
                f"{one} and {other} move together (correlation {correlation:+.3f}): their "
                f"effects cannot be distinguished"
            )
            remedy = (
                "fly them one after the other, or as orthogonal multisines; else fix one at "
                "its a-priori value"
            )
            found.append(
                Finding(
                    "warning",
                    "collinear",
                    (one, other),
                    text,
                    remedy,
                    evidence={"correlation": correlation},
                )
            )
    if len(names) > 2 and not paired:
        multiple = np.sqrt(np.maximum(0.0, 1.0 - 1.0 / np.diag(np.linalg.pinv(values))))
        worst = int(np.argmax(multiple))
        if multiple[worst] > COLLINEAR:
            others = (*names[:worst], *names[worst + 1 :])
            text = (
                f"{names[worst]} is a combination of {', '.join(others)} (multiple "
                f"correlation {multiple[worst]:.3f})"
            )
            remedy = "fly the inputs one after the other, or as orthogonal multisines"
            found.append(Finding("warning", "collinear", (names[worst], *others), text, remedy))
    return found


def _inputs(signals: ResampledChannels) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return the inputs that move, and where they all are whole."""
    levers = [name for name in signals.values if name.endswith(".throttle")]
    names = [name for name in _INPUTS if name in signals]
    mask = signals.mask((*names, *levers))
    columns = {name: _quick(signals, name) for name in names}
    if levers:
        columns["throttle"] = np.mean([_quick(signals, name) for name in levers], axis=0)
    sizes = {name: _LEVER if name == "throttle" else _INPUT for name in columns}
    return {
        name: x
        for name, x in columns.items()
        if mask.any() and _rms(x, signals.step)[mask].max() > sizes[name]
    }, mask


def _quick(signals: ResampledChannels, name: str) -> np.ndarray:
    x = lowpass_if_possible(signals[name], signals.step, BAND)
    slow = lowpass_if_possible(x, signals.step, _TRIM_BAND)
    return x - (slow if slow is not x else x.mean())


def _rms(x: np.ndarray, step: float) -> np.ndarray:
    """Return the rms over a second around each sample."""
    width = max(round(_SECOND / step), 1)
    return np.sqrt(np.maximum(np.convolve(x**2, np.ones(width) / width, mode="same"), 0.0))


def _held(moving: np.ndarray, step: float) -> np.ndarray:
    """Return a mask that stays true for the three seconds in which an input is answered."""
    return np.convolve(moving, np.ones(max(round(3.0 / step), 1)), mode="full")[: len(moving)] > 0.5


def _frequency(x: np.ndarray, step: float) -> float:
    power = np.cumsum(np.abs(np.fft.rfft(x - x.mean())) ** 2)
    return (
        float(np.searchsorted(power, 0.9 * power[-1]) / (len(x) * step))
        if power[-1] > 0.0
        else float("nan")
    )
