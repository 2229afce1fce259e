"""Control forces over a sweep: force at equal position, breakout force and dead band."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pom.judging.signals import WHO, Comparison, event_time
from pom.tolerances.bands import (
    NAN,
    ROUNDING,
    Invalid,
    Judgement,
    RowRemark,
    applied_tolerance,
    band_ratios,
    half_width,
    inside_window,
    judge_number,
)
from pom.tolerances.criteria import Criterion

# The four limits are our choice, not values of a standard.
TURN = 0.05  # of the travel: smaller reversals are noise and do not start a branch
SLACK = 0.02  # of the travel after a turn, where friction changes sides
COVER = 0.9  # of the flight's travel on a branch: least part that the model has to cover
START = 0.01  # of the travel: beyond it the control has left its start
DIRECTIONS = {1: "increasing", -1: "decreasing"}


@dataclass(frozen=True)
class Branch:
    """A part of a sweep in which the control moves one way: 1 increasing, -1 decreasing.

    Attributes
    ----------
    direction : int
    time : array (time,)
        [s]
    x, y : array (time,)
        Position of the control, and force or response. [SI]
    """

    direction: int
    time: np.ndarray
    x: np.ndarray
    y: np.ndarray

    def at(self, x: np.ndarray) -> np.ndarray:
        """Return y at positions x by linear interpolation; NaN beyond the branch."""
        # np.interp requires rising positions, and a branch may decrease
        order = np.argsort(self.x, kind="stable")
        return np.interp(x, self.x[order], self.y[order], left=np.nan, right=np.nan)

    def common_duration(self, partner: Branch) -> float:
        """Return the common duration of two branches; negative if they do not overlap. [s]

        It is minus infinity for branches of opposite directions.
        """
        if self.direction != partner.direction:
            return -np.inf
        return float(min(self.time[-1], partner.time[-1]) - max(self.time[0], partner.time[0]))


# Spread of the cycles over the mean dead band from which a remark states it.
_LARGEST_SPREAD = 0.25


def judge_curve(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge y over x of a slow sweep, at equal x on the same branch.

    Every flight sample counts. A percentage is of the flight value at that x.
    """
    mask = inside_window(match.time, criterion.window)
    flight, model = _split_branches(criterion, match, mask)
    return _judge_branches(criterion, flight, model)


def force_increment(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the force of a moderate or rapid sweep less the force of the slow sweep.

    The forces are compared at equal position and direction. The slow (static) sweep lies between
    the events ``static_sweep_start`` and ``static_sweep_end``.
    """
    rapid = inside_window(match.time, criterion.window)
    static_window = (
        event_time(match, "static_sweep_start"),
        event_time(match, "static_sweep_end"),
    )
    static = inside_window(match.time, static_window)
    rapid_flight, rapid_model = _split_branches(criterion, match, rapid)
    static_flight, static_model = _split_branches(criterion, match, static)
    return _judge_branches(
        criterion,
        _subtract_static(rapid_flight, static_flight),
        _subtract_static(rapid_model, static_model),
    )


def _split_branches(
    criterion: Criterion, match: Comparison, mask: np.ndarray
) -> tuple[list[Branch], list[Branch]]:
    """Return the branches of flight and model, without the samples next to a turn."""
    time, *positions = match.over(mask, criterion.abscissa)
    _, *forces = match.over(mask, criterion.channel)
    sweeps = []
    for who, x, y in zip(WHO, positions, forces, strict=True):
        # All limits are shares of the travel of the same run.
        travel = float(np.ptp(x))
        if travel <= 0.0:
            raise Invalid(f"{who} does not move {criterion.abscissa}")
        direction = motion_directions(x, TURN * travel)
        branches = []
        # A part is a range of samples with one direction.
        for part in np.split(np.arange(x.size), np.flatnonzero(np.diff(direction)) + 1):
            sign = int(direction[part[0]])
            samples = part[_is_progress(sign * (x[part] - x[part[0]]), SLACK * travel)]
            if samples.size > 1:
                branches.append(Branch(sign, time[samples], x=x[samples], y=y[samples]))
        sweeps.append(branches)
    return sweeps[0], sweeps[1]


def _is_progress(travel: np.ndarray, slack: float) -> np.ndarray:
    """Return the mask of samples beyond `slack` and farther than all earlier samples.

    While a control stands still, friction can hold it at any force.
    """
    farthest = np.maximum.accumulate(np.concatenate([[0.0], travel[:-1]]))
    return (travel > slack) & (travel > farthest)


def motion_directions(x: np.ndarray, least: float) -> np.ndarray:
    """Return the direction of every sample: 1 while x rises, -1 while it falls (time,).

    The direction changes at an extreme from which x moves back by `least`. It is zero for all
    samples if x does not move that far.
    """
    directions = np.zeros(x.size, int)
    current, extreme, since = 0, 0, 0
    low = high = 0  # samples of the extremes before the first direction is certain
    for i, value in enumerate(x):
        if current == 0:
            # No direction yet: it starts at the extreme from which x moved by `least`.
            if value < x[low]:
                low = i
            if value > x[high]:
                high = i
            if value - x[low] > least:
                current, extreme, since = 1, i, low
            elif x[high] - value > least:
                current, extreme, since = -1, i, high
        elif current * (value - x[extreme]) >= 0.0:
            extreme = i
        elif current * (x[extreme] - value) > least:
            # The branch ended at its extreme, and the next one started there.
            directions[since : extreme + 1] = current
            current, since, extreme = -current, extreme + 1, i
    directions[since:] = current
    return directions


def _subtract_static(rapid: list[Branch], static: list[Branch]) -> list[Branch]:
    """Return rapid branches with y above the static sweep, where the static sweep covers x."""
    increments = []
    for branch in rapid:
        # Forces of the static branches at the positions of the rapid branch (branch, sample).
        levels = [np.full(branch.x.size, np.nan)]
        parallel = [item for item in static if item.direction == branch.direction]
        if parallel:
            levels = [item.at(branch.x) for item in parallel]
        # Of several static branches, the first that covers the position.
        first = np.argmax(np.isfinite(levels), axis=0)
        increment = branch.y - np.array(levels)[first, np.arange(branch.x.size)]
        covered = np.isfinite(increment)
        if covered.sum() > 1:
            increments.append(
                Branch(
                    branch.direction,
                    branch.time[covered],
                    x=branch.x[covered],
                    y=increment[covered],
                )
            )
    return increments


def _judge_branches(criterion: Criterion, flight: list[Branch], model: list[Branch]) -> Judgement:
    """Judge the model at every flight sample, on the branch that runs at the same time."""
    times, widths, errors, values = [], [], [], []
    for branch in flight:
        direction = DIRECTIONS[branch.direction]
        partner = max(model, key=branch.common_duration, default=None)
        if partner is None or branch.common_duration(partner) <= 0.0:
            raise Invalid(
                f"the model does not move {criterion.abscissa} as the flight does, {direction}"
            )
        # NaN where the model does not come to the position of the flight
        response = partner.at(branch.x)
        covered = np.isfinite(response)
        share = 0.0
        if covered.any():
            share = np.ptp(branch.x[covered]) / np.ptp(branch.x)
        if share < COVER:
            raise Invalid(
                f"the model comes through {100.0 * share:.0f} % of the flight's {direction} travel "
                f"of {criterion.abscissa}"
            )
        times.append(branch.time[covered])
        values.append(branch.y[covered])
        widths.append(half_width(criterion, branch.y[covered]))
        errors.append(response[covered] - branch.y[covered])
    if not times:
        raise Invalid(f"the flight has no sweep of {criterion.abscissa} in the window")
    time, width = np.concatenate(times), np.concatenate(widths)
    error, value = np.concatenate(errors), np.concatenate(values)
    ratio = band_ratios(error, width)
    outside, worst = ratio > 1.0 + ROUNDING, int(np.argmax(ratio))
    verdict, first_exit = "pass", NAN
    if outside.any():
        verdict, first_exit = "fail", float(time[outside].min())
    return Judgement(
        verdict=verdict,
        width=float(width.min()),
        worst=float(error[worst]),
        worst_ratio=float(ratio[worst]),
        at=float(time[worst]),
        first_exit=first_exit,
        inside=float(1.0 - outside.mean()),
        remarks=(_branch_remark(len(times), criterion.abscissa),),
        applied=applied_tolerance(criterion, width, value),
        rms=float(np.sqrt(np.mean(np.square(ratio)))),
    )


def _branch_remark(count: int, abscissa: str) -> RowRemark:
    plural = "es" if count > 1 else ""
    text = f"{count} branch{plural} at equal {abscissa}"
    return RowRemark("method", text, abscissa, values={"branches": float(count)}, unit="1")


def judge_breakout(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the force at which the control leaves its start, in every direction of the sweep."""
    mask = inside_window(match.time, criterion.window)
    time, *positions = match.over(mask, criterion.abscissa)
    _, *forces = match.over(mask, criterion.channel)
    # the same distance for both, a share of the travel in flight
    least = START * float(np.ptp(positions[0]))
    judged = []
    # A sweep may move in both directions; the worst one decides.
    for sign, direction in DIRECTIONS.items():
        flight = _first_force(positions[0], forces[0], sign, least=least)
        model = _first_force(positions[1], forces[1], sign, least=least)
        if flight is None:
            continue
        if model is None:
            raise Invalid(f"the model does not move {criterion.abscissa} {direction}")
        text = f"{direction}: {flight:.1f} N in flight, {model:.1f} N in the model"
        values = {"flight": flight, "model": model}
        remark = RowRemark("values", text, criterion.channel, values=values, unit="N")
        judged.append(judge_number(criterion, flight, model, at=float(time[0]), remarks=(remark,)))
    if not judged:
        raise Invalid(f"the flight does not move {criterion.abscissa}")
    worst = max(judged, key=lambda outcome: outcome.worst_ratio)
    remarks: list[RowRemark] = []
    for outcome in judged:
        remarks += outcome.remarks
    return replace(worst, remarks=tuple(remarks))


def _first_force(x: np.ndarray, force: np.ndarray, direction: int, *, least: float) -> float | None:
    """Return the force at which x first leaves its start by `least`; None if it does not. [SI]"""
    distance = direction * (x - x[0])
    if not (distance > least).any():
        return None
    # linear between the last sample inside and the first sample beyond
    k = int(np.argmax(distance > least))
    return float(np.interp(least, distance[k - 1 : k + 1], force[k - 1 : k + 1]))


def judge_dead_band(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the dead band of the nose-wheel steering.

    It is the difference of the wheel angle between the two directions, at neutral pedals. Several
    cycles are averaged; a remark states how far they differ.
    """
    mask = inside_window(match.time, criterion.window)
    bands = []
    remarks = []
    for who, branches in zip(WHO, _split_branches(criterion, match, mask), strict=True):
        # by direction: the wheel angles at neutral pedals
        angles: dict[int, list[float]] = {-1: [], 1: []}
        for branch in branches:
            angle = float(branch.at(np.zeros(1))[0])
            if np.isfinite(angle):
                angles[branch.direction].append(angle)
        if not all(angles.values()):
            raise Invalid(
                f"{who} does not bring {criterion.abscissa} through neutral in both directions"
            )
        bands.append(abs(float(np.mean(angles[-1])) - float(np.mean(angles[1]))))
        spread = max(max(group) - min(group) for group in angles.values())
        if spread > _LARGEST_SPREAD * bands[-1]:
            text = (
                f"{who}: the cycles differ by {np.degrees(spread):.2f} deg at neutral, their mean "
                f"band is {np.degrees(bands[-1]):.2f} deg"
            )
            remarks.append(RowRemark("method", text, criterion.channel))
    judged = judge_number(criterion, bands[0], bands[1], at=criterion.window[0])
    return replace(judged, remarks=(*judged.remarks, *remarks))
