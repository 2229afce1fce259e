"""Columns of two engines that were exchanged: each engine has to follow its own lever.

An engine whose lever moves by itself shows which lever is its own: the difference of two outputs
follows the difference of their levers.  Outputs that were exchanged follow it with the other sign.
One engine that fails makes such a difference too, so both outputs have to show the exchange.  An
engine whose fuel is cut off shows it too: its speed, torque, fuel flow and thrust fall below those
of the engine that runs.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pandas as pd

from flightmech.aircraft.aircraft import Aircraft
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import Finding

# The speed of a propeller is held by its governor and does not follow the lever.
_OUTPUTS = ("n1", "n2", "torque", "fuel_flow", "thrust")
_LEVERS = ("throttle", "pla")
_LAGS = (0.3, 1.0, 3.0)  # s: time constants of engines, from a slow piston to a turbofan
_LEVER_MOVES = 0.03  # standard deviation of the difference of two levers [1, rad] that informs
_ENGINE_MOVES = 0.05  # that of an output, over its largest value
_FOLLOWS, _RATHER = 0.8, 0.3  # correlation with a lever, and its excess over the other one
_RISES = 0.3  # of the range of an output, by which an engine that fails does not rise
_RUN_DOWN = 3.0  # s after the cut in which an engine still turns
_SHORTEST = 2.0  # s of one engine cut off and one running
_ABOVE = 2.0  # times the output of the other engine: larger than scatter
_ROW = ("engine_columns", "columns of the engines")

Unchecked = list[tuple[str, str, tuple[str, ...], str]]


def side_findings(
    signals: ResampledChannels, aircraft: Aircraft
) -> tuple[list[Finding], Unchecked]:
    """Return the findings on exchanged columns of two engines, and what was not checked.

    Parameters
    ----------
    signals : ResampledChannels
    aircraft : Aircraft
        With its engines.

    Returns
    -------
    findings : list of Finding
        A warning for each output that follows the lever of another engine, and for cutoffs that
        contradict engines which follow their own levers.
    unchecked : list of tuple
        A row if two engines are recorded and no output shows its own lever.
    """
    findings: list[Finding] = []
    compared: list[str] = []
    shown: set[str] = set()
    contradicted: dict[tuple[str, ...], str] = {}
    for i, j in combinations(range(1, len(aircraft.engines) + 1), 2):
        for output in _OUTPUTS:
            names = (f"engine{i}.{output}", f"engine{j}.{output}")
            if not all(name in signals for name in names):
                continue
            compared += names
            by_cut = _cut_evidence(signals, (i, j), names)
            by_lever = _lever_evidence(signals, (i, j), names)
            evidence = by_cut + by_lever
            cutoffs: tuple[str, ...] = ()
            if by_cut:
                cutoffs = (f"engine{i}.cutoff", f"engine{j}.cutoff")
            exchanged = [text for belongs, text in evidence if not belongs]
            if evidence:
                shown.update(names)
            # an engine that follows its own lever settles the question
            if exchanged and len(exchanged) == len(evidence):
                findings.append(_exchange_finding(names, exchanged, cutoffs))
            turned = [text for belongs, text in by_cut if not belongs]
            followed = [text for belongs, text in by_lever if belongs]
            if turned and followed:
                contradicted[cutoffs] = f"{turned[0]}, and {followed[0]}"
    for cutoffs, text in contradicted.items():
        text = f"{' and '.join(cutoffs)} have the other sense: {text}"
        findings.append(Finding("warning", "sign", cutoffs, text, _sense_remedy(cutoffs)))
    open_names = tuple(name for name in dict.fromkeys(compared) if name not in shown)
    if not open_names:
        return findings, []
    return findings, [(*_ROW, open_names, _open_reason(signals, open_names))]


def _open_reason(signals: ResampledChannels, names: tuple[str, ...]) -> str:
    """Return why outputs show no lever of their own, and what to do."""
    numbers = sorted({int(name.partition(".")[0].removeprefix("engine")) for name in names})
    pairs = [_levers_of(signals, pair) for pair in combinations(numbers, 2)]
    recorded = [pair for pair in pairs if pair]
    if not recorded:
        return "the levers are not recorded for both engines: map their channels"
    splits = [float(np.std(signals[first] - signals[second])) for first, second in recorded]
    remedy = "move one lever by itself, down and up, or compare the columns with the instruments"
    if max(splits) < _LEVER_MOVES:
        return f"the levers never move differently and no engine is cut off: {remedy}"
    return (
        "the levers move differently, but the outputs of both engines do not show one lever each, "
        f"as when an engine fails or is at its limit: {remedy}"
    )


def _exchange_finding(
    names: tuple[str, str], texts: list[str], cutoffs: tuple[str, ...]
) -> Finding:
    """Return the warning that an output follows the lever of the other engine.

    A fuel lever that is recorded as 1 when it is open looks the same as an exchange.
    """
    sense = f", or {' and '.join(cutoffs)} are 1 for an engine that runs" if cutoffs else ""
    text = f"{names[0]} and {names[1]} look exchanged, or the levers are{sense}: {'; '.join(texts)}"
    remedy = (
        f"compare the columns of both engines in the name map with the instruments; exchange those "
        f"of {names[0]} and {names[1]}, or those of the levers if all outputs are listed here"
    )
    if cutoffs:
        remedy += f"; {_sense_remedy(cutoffs)}"
    return Finding("warning", "column", names, text, remedy)


def _sense_remedy(cutoffs: tuple[str, ...]) -> str:
    """Return how to turn the sense of cutoffs."""
    return (
        f"a cutoff is 0 with the fuel open and 1 with it cut off: if the file has the other sense, "
        f"give {' and '.join(cutoffs)} sign = -1, offset = 1 in the name map"
    )


def _cut_evidence(
    signals: ResampledChannels, engines: tuple[int, int], names: tuple[str, str]
) -> list[tuple[bool, str]]:
    """Return whether an engine that is cut off has the lower output, with its text.

    Empty if both run, or if the outputs do not differ clearly.
    """
    cutoffs = [f"engine{number}.cutoff" for number in engines]
    if not all(name in signals for name in cutoffs):
        return []
    cut = [signals[name] > 0.5 for name in cutoffs]
    evidence = []
    for dead, live in ((0, 1), (1, 0)):
        stopped = cut[dead] & ~cut[live]
        # an engine still turns for a while after the cut
        samples = max(1, round(_RUN_DOWN / signals.step))
        stopped = pd.Series(stopped).rolling(samples, min_periods=1).min().to_numpy() > 0.5
        if float(stopped.sum()) * signals.step < _SHORTEST:
            continue
        low, high = (float(np.median(signals[names[k]][stopped])) for k in (dead, live))
        text = (
            f"engine {engines[dead]} is cut off and engine {engines[live]} is not, where "
            f"{names[dead]} is {low:.3g} and {names[live]} is {high:.3g}"
        )
        # outputs near zero differ by their noise
        least = _ENGINE_MOVES * max(float(np.max(np.abs(signals[name]))) for name in names)
        if high > max(_ABOVE * low, least):
            evidence.append((True, text))
        elif low > max(_ABOVE * high, least):
            evidence.append((False, text))
    return evidence


def _lever_evidence(
    signals: ResampledChannels, engines: tuple[int, int], names: tuple[str, str]
) -> list[tuple[bool, str]]:
    """Return whether each engine follows its own lever rather than the other, with its text.

    Empty if the levers move together, or if the engines do not show it.
    """
    levers = _levers_of(signals, engines)
    if not levers:
        return []
    u = [signals[name] for name in levers]
    if float(np.std(u[0] - u[1])) < _LEVER_MOVES:
        return []
    split, apart = u[0] - u[1], signals[names[0]] - signals[names[1]]
    evidence = []
    against = []
    moving = []
    for k, name in enumerate(names):
        y = signals[name]
        if not float(np.std(y)) > _ENGINE_MOVES * float(np.max(np.abs(y))):
            continue
        moving.append(y)
        own, other = (lever_correlation(u[m], y, signals.step) for m in (k, 1 - k))
        if own > _FOLLOWS and own > other + _RATHER:
            text = f"{name} follows {levers[k]} (correlation {own:.2f})"
            evidence.append((True, text))
        elif other > _FOLLOWS and other > own:
            text = (
                f"{name} follows {levers[1 - k]} (correlation {other:.2f}) rather than "
                f"{levers[k]} ({own:.2f})"
            )
            against.append((False, text))
    if evidence or not moving:
        return evidence
    # What both levers do together cancels in the differences.
    if lever_correlation(split, apart, signals.step) > _FOLLOWS:
        return [(True, f"the difference of {' and '.join(names)} follows that of the levers")]
    turned = lever_correlation(split, -apart, signals.step) > _FOLLOWS
    # A single output that falls may be that of an engine that fails.
    both = len(moving) == len(names) or _rises(moving[0])
    if turned and both and len(against) == len(moving):
        return against
    return []


def _rises(y: np.ndarray) -> bool:
    """Return whether an output rises by a good part of its range, as no engine that fails does."""
    return bool(np.max(y - np.minimum.accumulate(y)) > _RISES * float(np.ptp(y)))


def _levers_of(signals: ResampledChannels, engines: tuple[int, int]) -> tuple[str, ...]:
    """Return the levers of both engines, of one kind; empty without them."""
    for lever in _LEVERS:
        names = tuple(f"engine{number}.{lever}" for number in engines)
        if all(name in signals for name in names):
            return names
    return ()


def lever_correlation(lever: np.ndarray, output: np.ndarray, step: float) -> float:
    """Return the largest correlation of an output with a lever behind a first-order lag."""
    # reading a record filters nothing: SciPy's part takes half a second to import
    from scipy.signal import lfilter

    if not float(np.std(lever)) > 0.0:
        return 0.0
    best = -1.0
    for lag in _LAGS:
        share = 1.0 - np.exp(-step / lag)
        # the steady state of the first sample
        start = [(1.0 - share) * lever[0]]
        slow, _ = lfilter([share], [1.0, share - 1.0], lever, zi=start)
        if float(np.std(slow)) > 0.0:
            best = max(best, float(np.corrcoef(slow, output)[0, 1]))
    return best
