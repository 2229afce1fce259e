"""Surfaces whose columns are exchanged: each moves the axis of another one and not its own.

Each angular acceleration is regressed on rates, flow angle and all surfaces that move.  The share
of its variance that one surface alone explains shows which surface moves the axis.  Elevator and
rudder do not act on each other's axis.  Aileron and rudder do, with less than a third of the share.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np
import pandas as pd
import xarray as xr

from flighttest.reconstruction.quality.checks.control_response import (
    EQUATIONS,
    MOVED,
    SHORTEST,
    SIGNIFICANT,
    Equation,
    lowpass_channel,
    relative_pressure,
    remove_trim,
)
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.checks.surface_timing import regress_last_column
from flighttest.reconstruction.quality.finding import Finding, exchange_channels, iterate_rows
from flighttest.records.signals.differentiation import derivative

Unchecked = list[tuple[str, str, tuple[str, ...], str]]

# share of the variance that a surface alone must explain, and that of the mapped one over it.
# T-37 records have 0.05 to 0.79 and less than 0.27.
_SHARE, _LESS = 0.03, 0.35
# the same of one surface without its counterpart; the axis that it moves must be explained
_LARGE_SHARE, _NONE, _EXPLAINED = 0.1, 0.02, 0.4
# least movement of that surface, and share of its own axis that the other columns must leave: a
# rudder that coordinates a turn goes with the pitch rate, and sideslip and roll explain its yaw
_WIDELY, _ALL = 2.0 * MOVED, 0.95
_LOWEST_R2 = 0.15
_AXES = {"q": "pitch", "p": "roll", "r": "yaw"}


@dataclass(frozen=True)
class SurfaceShares:
    """Shares of the variance of one angular acceleration, by surface.

    Attributes
    ----------
    alone : dict of float
        Share that a surface explains and the other columns do not.
    ratio : dict of float
        Effect over its standard error.
    explained : float
        Share that all columns explain.
    """

    alone: dict[str, float]
    ratio: dict[str, float]
    explained: float


def exchanged_findings(signals: ResampledChannels, record: xr.DataTree) -> list[Finding]:
    """Return the findings on surfaces that move the axis of another surface and not their own.

    Parameters
    ----------
    signals : ResampledChannels
        Without mistakes and delays of rates and flow angles.
    record : DataTree
        Its channels have their entries of the name map.
    """
    shares = surface_shares(signals)
    for first, second in combinations(EQUATIONS, 2):
        if _are_exchanged(shares, first, second):
            return [_exchange_finding(shares, first, second, record=record)]
    findings = []
    for own in EQUATIONS:
        for other in EQUATIONS:
            if own != other and _moves_other_axis(shares, own, other, signals):
                findings.append(_one_sided_finding(shares, own, other))
    return findings


def answers_not_checked(answers: pd.DataFrame, signals: ResampledChannels) -> Unchecked:
    """Return the surfaces whose sign, column and size the record does not show.

    Parameters
    ----------
    answers : DataFrame
        Result of `control_responses`.
    signals : ResampledChannels
    """
    rows: Unchecked = []
    shown = {row.surface: row for row in iterate_rows(answers)}
    for equation in EQUATIONS:
        name = equation.surface
        if name not in signals:
            continue
        row = shown.get(name)
        if row is None:
            reason = f"{name} or {equation.rate} does not move, or is not recorded"
        elif row.R2 >= _LOWEST_R2 and abs(row.ratio) >= SIGNIFICANT:
            continue
        else:
            reason = (
                f"{equation.rate}_dot is {row.effect:+.2f} 1/s2 per rad of it, standard error "
                f"{row.stderr:.2f}: a 3-2-1-1 or a doublet of {name} shows it"
            )
        rows.append((f"answer_{name}", f"sign and column of {name}", (), reason))
    return rows


def with_surfaces(signals: ResampledChannels, exchanged: list[Finding]) -> ResampledChannels:
    """Return the signals with the surfaces that are certainly exchanged in their own channels."""
    for finding in exchanged:
        if finding.severity == "error":
            one, other = finding.channels
            signals = signals.with_values({one: signals[other], other: signals[one]})
    return signals


def without_surfaces(answers: list[Finding], exchanged: list[Finding]) -> list[Finding]:
    """Return the findings on controls other than on surfaces that move another axis.

    Their lines of the name map would be those of the other surface.
    """
    surfaces = set(chain.from_iterable(finding.channels for finding in exchanged))
    return [finding for finding in answers if finding.channels[0] not in surfaces]


def surface_shares(signals: ResampledChannels) -> dict[str, SurfaceShares]:
    """Return the shares of the surfaces in each angular acceleration, by rate."""
    surfaces = []
    for equation in EQUATIONS:
        name = equation.surface
        if name in signals and np.ptp(signals[name]) > 0.0:
            surfaces.append(name)
    shares = {}
    for equation in EQUATIONS:
        found = _shares_of(equation, surfaces, signals)
        if found is not None:
            shares[equation.rate] = found
    return shares


def _shares_of(
    equation: Equation, surfaces: list[str], signals: ResampledChannels
) -> SurfaceShares | None:
    """Return the shares in one acceleration; None for too short a record or a rate at rest."""
    if equation.rate not in signals or not surfaces:
        return None
    motions = []
    for name in equation.others:
        if name in signals and name not in surfaces and np.ptp(signals[name]) > 0.0:
            motions.append(name)
    mask = signals.mask((equation.rate, *motions, *surfaces))
    if mask.sum() * signals.step < SHORTEST or not np.ptp(signals[equation.rate][mask]) > 0.0:
        return None
    # as of `control_responses`: constant coefficients at changing speed
    scale = relative_pressure(signals, mask)
    acceleration = derivative(lowpass_channel(signals, equation.rate), signals.step, 5, order=2)
    y = remove_trim(acceleration / scale, signals)[mask]
    columns = {}
    for name in (*motions, *surfaces):
        column = lowpass_channel(signals, name)
        if name in "pqr":
            column = column / np.sqrt(scale)
        columns[name] = remove_trim(column, signals)[mask]
    explained = _explained_share(y, list(columns.values()))
    alone, ratio = {}, {}
    for name in surfaces:
        others = [column for other, column in columns.items() if other != name]
        alone[name] = explained - _explained_share(y, others)
        ratio[name] = 0.0
        if alone[name] >= _SHARE:
            fit = regress_last_column(y, [*others, columns[name]], mask, signals.step)
            if fit is not None:
                ratio[name] = fit[0] / max(fit[1], 1e-300)
    return SurfaceShares(alone, ratio, explained)


def _explained_share(y: np.ndarray, columns: list[np.ndarray]) -> float:
    if not columns:
        return 0.0
    X = np.stack(columns, axis=1)
    X = X / np.maximum(X.std(axis=0), 1e-12)
    theta = np.linalg.lstsq(X, y, rcond=1e-10)[0]
    return 1.0 - float(np.var(y - X @ theta) / max(np.var(y), 1e-300))


def _are_exchanged(shares: dict[str, SurfaceShares], first: Equation, second: Equation) -> bool:
    """Return whether each of two surfaces moves the axis of the other one, and not its own."""
    return _acts_instead(shares, first.rate, mapped=first.surface, acting=second.surface) and (
        _acts_instead(shares, second.rate, mapped=second.surface, acting=first.surface)
    )


def _acts_instead(shares: dict[str, SurfaceShares], rate: str, *, mapped: str, acting: str) -> bool:
    if rate not in shares:
        return False
    of_rate = shares[rate]
    share = of_rate.alone.get(acting, 0.0)
    if mapped not in of_rate.alone or share < _SHARE or of_rate.explained < _LOWEST_R2:
        return False
    return of_rate.alone[mapped] < _LESS * share and abs(of_rate.ratio[acting]) >= SIGNIFICANT


def _moves_other_axis(
    shares: dict[str, SurfaceShares], own: Equation, other: Equation, signals: ResampledChannels
) -> bool:
    """Return whether a surface moves the axis `other` and not its own one."""
    name = own.surface
    if own.rate not in shares or other.rate not in shares or name not in signals:
        return False
    of_own, of_other = shares[own.rate], shares[other.rate]
    if name not in of_other.alone or np.ptp(signals[name]) < _WIDELY or of_own.explained > _ALL:
        return False
    answers = of_other.alone[name] > _LARGE_SHARE and of_other.explained > _EXPLAINED
    certain = abs(of_other.ratio[name]) >= 2.0 * SIGNIFICANT
    by_mapped = of_other.alone.get(other.surface, 0.0) > _NONE * of_other.alone[name]
    return answers and certain and of_own.alone[name] < _NONE and not by_mapped


def _exchange_finding(
    shares: dict[str, SurfaceShares], first: Equation, second: Equation, *, record: xr.DataTree
) -> Finding:
    one, two = first.surface, second.surface
    parts = []
    reversed_sign = []
    for equation, acting in ((first, two), (second, one)):
        alone = shares[equation.rate].alone
        parts.append(
            f"{acting} alone explains {alone[acting]:.0%} of {equation.rate}_dot, "
            f"{equation.surface} {max(alone[equation.surface], 0.0):.0%}"
        )
        if shares[equation.rate].ratio[acting] > 0.0:
            reversed_sign.append(equation.surface)
    text = f"{one} and {two} are exchanged: {'; '.join(parts)}"
    remedy = exchange_channels(record, one, two)
    if reversed_sign:
        remedy += f"\n    the sign of {' and '.join(reversed_sign)} is then to be reversed"
    evidence = {
        first.rate: shares[first.rate].alone,
        second.rate: shares[second.rate].alone,
    }
    return Finding("error", "axis", (one, two), text, remedy, evidence=evidence)


def _one_sided_finding(shares: dict[str, SurfaceShares], own: Equation, other: Equation) -> Finding:
    name = own.surface
    text = (
        f"{name} moves and {_AXES[own.rate]} does not answer: it alone explains "
        f"{max(shares[own.rate].alone[name], 0.0):.0%} of {own.rate}_dot and "
        f"{shares[other.rate].alone[name]:.0%} of {other.rate}_dot"
    )
    remedy = f"check whether the columns of {name} and {other.surface} are exchanged"
    evidence = {"own": shares[own.rate].alone[name], "other": shares[other.rate].alone[name]}
    channels = (name, other.surface, own.rate)
    return Finding("warning", "axis", channels, text, remedy, evidence=evidence)
