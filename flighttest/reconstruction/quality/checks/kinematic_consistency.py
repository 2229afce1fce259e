"""Kinematic consistency in figures and findings: what mistakes there are, and how well the rest
agrees.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.reconstruction.quality.checks.mistake_search import (
    Explanation,
    plausible_range,
    units_mistaken,
)
from flighttest.reconstruction.quality.checks.relation_check import RelationCheck
from flighttest.reconstruction.quality.checks.relations import RELATIONS, compare_all
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import (
    Finding,
    add_delay_line,
    exchange_channels,
    iterate_rows,
    map_entry,
)
from flighttest.records.sensors.instruments import Instruments
from flighttest.records.signals.delays import Delay, time_delay

SLOW = 0.4  # s that air data and satellite receivers may be late without a specification
FAST = 0.06  # s that may lie between attitude, rates and vanes
_SHARE = 0.95  # correlation below which two channels differ in more than time
_LONGEST = 60.0  # s of one stretch
_SEARCHED = 2.0  # s of delay, either way
_PAIRS = {  # relation -> the channel that is late when its first side is, against what
    "phi_rate": ("phi", "p q r"),
    "theta_rate": ("theta", "q r"),
    "psi_rate": ("psi", "q r"),
    "force_z": ("vn", "az_imu"),
    "slip": ("beta_vane", "r p ay_imu"),
    "heave": ("alpha_vane", "q az_imu"),
    "along": ("V", "ax_imu az_imu"),
    "climb": ("h_baro", "vd"),
}
_REVERSED = {"force_z", "climb"}  # the late channel stands on the second side
_VANES = ("alpha_vane", "beta_vane")
_SLOW_CHANNELS = ("vn", "V", "h_gps", "h_baro", "q_c")


def find_lags(signals: ResampledChannels, placed: Iterable[str] = ()) -> pd.DataFrame:
    """Return the delays that the record can determine.

    Parameters
    ----------
    signals : Signals
        With right signs and units.
    placed : iterable of str
        Channels whose place on the aeroplane was taken into account; a vane far ahead of the c.g.
        seems to be early or late otherwise.

    Returns
    -------
    DataFrame
        ``channel against delay stderr correlation bound``; positive when the channel is late [s].
        Where `bound`, the delay lies at the end of the search: it is at least so long, and has no
        standard error (infinite).
    """
    table: list = []
    for relation in RELATIONS:
        if relation.name not in _PAIRS or relation.missing(signals):
            continue
        if _PAIRS[relation.name][0] in _VANES and not {_PAIRS[relation.name][0], "ax_imu"} <= set(
            placed
        ):
            continue
        mask = signals.mask(relation.channels(signals))
        first, second = relation.sides(signals.completed(relation.formed))
        late, other = (second, first) if relation.name in _REVERSED else (first, second)
        found = [
            delay
            for piece in _stretches(mask, late, signals.step)
            if (delay := _delay(other[piece], late[piece], signals.step))
        ]
        if found:
            table.append((*_PAIRS[relation.name], *_pooled(found)))
    return pd.DataFrame(
        table, columns=["channel", "against", "delay", "stderr", "correlation", "bound"]
    )


def lag_findings(
    table: pd.DataFrame, specification: Instruments | None, record: xr.DataTree
) -> list[Finding]:
    """Return delays that are longer than the aircraft file, or habit, allows."""
    found = []
    for row in iterate_rows(table):
        low, high, origin = _allowed(row.channel, specification)
        margin = 0.0 if row.bound else 3.0 * row.stderr
        if low - margin <= row.delay <= high + margin:
            continue
        measured = (
            f"{1e3 * abs(row.delay):.0f} ms {'late' if row.delay > 0 else 'early'} "
            f"against {row.against}"
        )
        allowed = f"{origin} allows {1e3 * low:.0f} to {1e3 * high:.0f} ms"
        if row.bound:
            text = f"{row.channel} is at least {measured}, the end of the search; {allowed}"
            remedy = (
                "compare the clocks of the two instruments, and put the time between them "
                "into the name map"
            )
        else:
            text = (
                f"{row.channel} is {measured} (standard error {1e3 * row.stderr:.1f} ms); {allowed}"
            )
            remedy = (
                f"{add_delay_line(record, row.channel, delay=row.delay)}, and the same "
                f"delay for the other channels of that instrument"
            )
        evidence = {
            "delay": row.delay,
            "stderr": None if row.bound else row.stderr,
            "bound": bool(row.bound),
        }
        found.append(Finding("warning", "lag", (row.channel,), text, remedy, evidence=evidence))
    return found


def _allowed(channel: str, specification: Instruments | None) -> tuple[float, float, str]:
    given = specification.of(channel) if specification is not None else None
    for pair in (given.delay, given.lag) if given is not None else ():
        if pair is not None:
            mean, sigma = pair
            return (
                min(0.0, mean - 3.0 * sigma) - FAST,
                mean + 3.0 * sigma + FAST,
                "the aircraft file",
            )
    limit = SLOW if channel in _SLOW_CHANNELS else FAST
    return -limit, limit, "habit"


def _stretches(mask: np.ndarray, motion: np.ndarray, step: float) -> list[slice]:
    """Return the whole stretches of at most a minute with the most motion in them, up to eight."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    longest = round(_LONGEST / step)
    pieces = [
        slice(a, min(a + longest, b))
        for start, b in zip(edges[::2], edges[1::2])
        for a in range(start, b, longest)
    ]
    pieces = [piece for piece in pieces if piece.stop - piece.start >= 256]
    return sorted(pieces, key=lambda piece: -float(np.var(motion[piece])))[:8]


def _delay(reference: np.ndarray, late: np.ndarray, step: float) -> Delay | None:
    try:
        found = time_delay(reference, late, step, _SEARCHED)
    except IdentificationError:
        return None
    return found if found.correlation > _SHARE else None


def _pooled(found: list[Delay]) -> tuple[float, float, float, bool]:
    """Return the weighted mean, its standard error inflated by the scatter, the median correlation,
    and whether it is only a bound.
    """
    correlation = float(np.median([one.correlation for one in found]))
    inside = [one for one in found if not one.bound]
    if 2 * len(inside) < len(found):
        nearest = min((one.estimate for one in found if one.bound), key=abs)
        return nearest, np.inf, correlation, True
    values, errors = (
        np.array([one.estimate for one in inside]),
        np.array([one.stderr for one in inside]),
    )
    errors = np.maximum(errors, 1e-4)
    weight = errors**-2 / np.sum(errors**-2)
    mean = float(weight @ values)
    birge = np.sqrt(np.sum(((values - mean) / errors) ** 2) / max(len(values) - 1, 1))
    return mean, float(max(1.0, birge) / np.sqrt(np.sum(errors**-2))), correlation, False


SCALE = 0.005  # deviation of a slope from one that is reported
GROSS_SCALE = 0.1  # and that is a warning
_STRAIGHT = 0.9995  # correlation above which a slope of half a per cent is informative
_CERTAIN = 2.5  # standard errors; they are wide, because few manoeuvres carry a slope
_SECONDS = 5.0  # of one block of the standard error of a slope
_SCALED = {  # relation -> channels named when the slope is not one
    "phi_rate": ("phi", "p"),
    "theta_rate": ("theta", "q"),
    "psi_rate": ("psi", "r"),
    "climb_rate": ("hdot", "h_baro"),
    "vane": ("alpha_vane",),
}
_COLUMNS = (
    "relation", "title", "units", "disagreement", "limit", "consistent", "moving", "correlation", "slope", "slope_stderr", "offset", "rms"
)  # fmt: skip
_UPWASH = (0.8, 1.35)  # slopes of a vane that are not a warning


def kinematic_table(signals: ResampledChannels) -> pd.DataFrame:
    """Return how every relation holds.

    Parameters
    ----------
    signals : Signals
        Mistakes undone, sensors at the c.g.

    Returns
    -------
    DataFrame
        ``relation title units disagreement limit consistent moving correlation slope slope_stderr
        offset rms``; slope of the first side over the second with its standard error between blocks
        of five seconds, offset and rms difference in `units`.
    """
    found = []
    for name, c in compare_all(signals).items():
        slope, stderr = _slope(c, signals.step)
        difference = (c.first - c.second)[c.mask]
        found.append(
            {
                "relation": name, "title": c.relation.title, "units": c.relation.units, "disagreement": c.disagreement,
                "limit": c.relation.limit, "consistent": c.consistent, "moving": c.moving, "correlation": c.correlation,
                "slope": slope, "slope_stderr": stderr, "offset": c.offset, "rms": float(np.std(difference)),
            }
        )  # fmt: skip
    return pd.DataFrame(found, columns=_COLUMNS)


def kinematic_findings(
    explanations: list[Explanation],
    comparisons: dict[str, RelationCheck],
    signals: ResampledChannels,
    record: xr.DataTree,
) -> list[Finding]:
    """Return the mistakes found, the relations that none of them resolves, and channels outside
    what is possible.
    """
    found = [_mistake(explanation, record) for explanation in explanations]
    for name, c in comparisons.items():
        if not c.consistent:
            text = (
                f"{c.relation.title} do not agree (disagreement {c.disagreement:.2f}), and no "
                f"single sign, unit or axis resolves it"
            )
            remedy = f"check {', '.join(c.relation.channels(signals))}; see the plot of {name}"
            found.append(
                Finding(
                    "warning",
                    "inconsistent",
                    c.relation.channels(signals),
                    text,
                    remedy,
                    evidence={"relation": name},
                )
            )
    for name in signals.values:
        found += _outside(name, signals, record)
    return found


def accuracy_findings(table: pd.DataFrame) -> list[Finding]:
    """Return scale errors among channels that agree otherwise, and the upwash of the vane."""
    found = []
    for row in iterate_rows(table):
        if row.relation not in _SCALED or not row.consistent:
            continue
        off = abs(row.slope - 1.0)
        if row.relation == "vane":
            found += _vane(row) if row.moving else []
        elif row.correlation > _STRAIGHT and off > SCALE and off > _CERTAIN * row.slope_stderr:
            names = _SCALED[row.relation]
            text = (
                f"{row.title}: the first is {row.slope:.3f} of the second (standard error "
                f"{row.slope_stderr:.3f})"
            )
            remedy = (
                f"a scale error of {' or '.join(names)}: let the reconstruction find it, or "
                f"calibrate"
            )
            severity = "warning" if off > GROSS_SCALE else "note"
            found.append(
                Finding(
                    severity,
                    "scale",
                    names,
                    text,
                    remedy,
                    evidence={"slope": row.slope, "stderr": row.slope_stderr},
                )
            )
    return found


def _vane(row) -> list[Finding]:
    if row.correlation < 0.9 or not (abs(row.slope - 1.0) > max(0.02, _CERTAIN * row.slope_stderr)):
        return []
    text = (
        f"alpha_vane shows {row.slope:.2f} of the angle that attitude and climb give "
        f"(standard error {row.slope_stderr:.2f}), "
        f"mean difference {np.degrees(row.offset):+.1f} deg: upwash and offset"
    )
    remedy = (
        "give factor and bias_sigma of the vane in the aircraft file; the reconstruction "
        "estimates them"
    )
    severity = "note" if _UPWASH[0] < row.slope < _UPWASH[1] else "warning"
    return [
        Finding(
            severity,
            "scale",
            ("alpha_vane",),
            text,
            remedy,
            evidence={"slope": row.slope, "offset": row.offset},
        )
    ]


def _mistake(explanation: Explanation, record: xr.DataTree) -> Finding:
    repair = explanation.repair
    corrected = ", ".join(
        f"{name} {before:.2f} to {after:.2f}"
        for name, before, after in zip(explanation.resolves, explanation.before, explanation.after)
    )
    others = "".join(f"; or {other.mistake}" for other in explanation.instead)
    text = f"{repair.mistake}{others} (disagreements that this resolves: {corrected})"
    changes = dict(zip(explanation.resolves, zip(explanation.before, explanation.after)))
    evidence = {"resolves": changes, "instead": [other.mistake for other in explanation.instead]}
    if repair.kind == "axis":
        remedy = exchange_channels(record, *repair.channels)
    else:
        remedy = map_entry(record, repair.channels[0], repair.slope, repair.shift)
    return Finding("error", repair.kind, repair.channels, text, remedy, evidence=evidence)


def _outside(name: str, signals: ResampledChannels, record: xr.DataTree) -> list[Finding]:
    limits = plausible_range(name)
    good = signals.good[name] & signals.flying
    if limits is None or not good.any():
        return []
    x = signals[name][good]
    outside = (x < limits[0]) | (x > limits[1])
    if outside.mean() < 0.001:
        return []
    for wrong, right, factor in units_mistaken(name):
        if limits[0] < factor * x.min() and factor * x.max() < limits[1]:
            text = (
                f"{name} is in {wrong} and was taken as {right}: it reaches "
                f"{np.abs(x).max():.4g} {right}, which is not possible"
            )
            return [Finding("error", "unit", (name,), text, map_entry(record, name, factor))]
    worst = float(x[np.argmax(np.abs(x - np.clip(x, *limits)))])
    text = (
        f"{name} reaches {worst:.4g}; possible are {limits[0]:g} to {limits[1]:g} (SI); "
        f"{outside.mean():.1%} of the flight lies outside"
    )
    return [
        Finding(
            "error",
            "range",
            (name,),
            text,
            "check unit, scale and column of the name map",
            evidence={"worst": worst},
        )
    ]


def _slope(c: RelationCheck, step: float) -> tuple[float, float]:
    """Return the slope and its standard error, from the scatter of what blocks of the record add to
    it.
    """
    y, x = (side[c.mask] - side[c.mask].mean() for side in (c.first, c.second))
    width = max(round(_SECONDS / step), 1)
    blocks = max(len(y) // width, 1)
    residual = (x * (y - c.slope * x))[: blocks * width]
    sums = residual.reshape(blocks, -1).sum(axis=1)
    return c.slope, float(
        np.sqrt((sums**2).sum() * blocks / max(blocks - 1, 1)) / max((x**2).sum(), 1e-30)
    )
