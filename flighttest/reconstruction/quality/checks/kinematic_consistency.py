"""Kinematic consistency of a record: mistakes, delays, and accuracy of channels that agree."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.names import WRAPPED
from flightmech.support.arrays import true_runs
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
    map_entry_of,
)
from flighttest.records.sensors.instruments import Instruments
from flighttest.records.signals.delays import Delay, time_delay

SLOW = 0.4  # s: delay of air data and satellite receivers that needs no specification
FAST = 0.06  # s: delay between attitude, rates and vanes that needs no specification
_SHARE = 0.95  # correlation below which two channels differ in more than time
_LONGEST = 60.0  # s of one stretch
_SEARCHED = 2.0  # s of delay, either way
_LEAST_SAMPLES = 256  # of a stretch
_MOST_STRETCHES = 8
_LEAST_STDERR = 1e-4  # s, in the weights of a mean delay
_SIGMAS = 3.0  # standard errors of a delay, and of the delay of a specification
# Relation -> the channel that is late if its first side is late, and the channels it is compared
# with.
_PAIRS = {
    "phi_rate": ("phi", "p q r"),
    "theta_rate": ("theta", "q r"),
    "psi_rate": ("psi", "q r"),
    "force_z": ("vn", "az_imu"),
    "slip": ("beta_vane", "r p ay_imu"),
    "heave": ("alpha_vane", "q az_imu"),
    "along": ("V", "ax_imu az_imu"),
    "climb": ("h_baro", "vd"),
}
# Relations with the late channel on the second side.
_REVERSED = {"force_z", "climb"}
_VANES = ("alpha_vane", "beta_vane")
_SLOW_CHANNELS = ("vn", "ve", "vd", "V", "V_cas", "V_eas", "mach", "h_gps", "h_baro", "q_c")


def find_lags(signals: ResampledChannels, placed: Iterable[str] = ()) -> pd.DataFrame:
    """Return the delays that the record can determine.

    Parameters
    ----------
    signals : ResampledChannels
        With correct signs and units.
    placed : iterable of str
        Channels that were moved to the c.g. Without this correction, a vane far ahead of the c.g.
        seems to be early or late.

    Returns
    -------
    DataFrame
        ``channel against delay stderr correlation bound``; positive if the channel is late [s]. A
        delay with `bound` lies at the end of the search. It is a lower limit and has an infinite
        standard error.
    """
    placed = set(placed)
    rows = []
    for relation in RELATIONS:
        if relation.name not in _PAIRS or relation.missing(signals):
            continue
        channel, against = _PAIRS[relation.name]
        # a formed airspeed has no entry in a name map; `fit_motion` times its source
        if channel not in signals:
            continue
        if channel in _VANES and not {channel, "ax_imu"} <= placed:
            continue
        mask = signals.mask(relation.channels(signals))
        late, reference = relation.sides(signals.completed(relation.formed))
        if relation.name in _REVERSED:
            late, reference = reference, late
        delays = _stretch_delays(reference, late, mask=mask, step=signals.step)
        if delays:
            rows.append((channel, against, *_pool_delays(delays)))
    columns = ["channel", "against", "delay", "stderr", "correlation", "bound"]
    return pd.DataFrame(rows, columns=columns)


def lag_findings(
    table: pd.DataFrame, specification: Instruments | None, record: xr.DataTree
) -> list[Finding]:
    """Return findings on delays longer than the aircraft file, or a common installation, allows.

    Parameters
    ----------
    table : DataFrame
        Result of `merge_delays`.
    specification : Instruments or None
    record : DataTree
    """
    findings = []
    for row in iterate_rows(table):
        low, high, origin = _allowed_delays(row.channel, specification)
        margin = row.margin
        if not row.bound:
            margin += _SIGMAS * row.stderr
        if not low - margin <= row.delay <= high + margin:
            allowed = f"{origin} {1e3 * low:.0f} to {1e3 * high:.0f} ms"
            findings.append(_lag_finding(row, allowed, record))
    return findings


def _lag_finding(row, allowed: str, record: xr.DataTree) -> Finding:
    direction = "early"
    if row.delay > 0:
        direction = "late"
    measured = f"{1e3 * abs(row.delay):.0f} ms {direction} against {row.against}"
    evidence = {"delay": row.delay, "stderr": row.stderr, "bound": bool(row.bound)}
    if row.bound:
        evidence["stderr"] = None
        text = f"{row.channel} is at least {measured}, the end of the search; {allowed}"
        remedy = (
            "compare the clocks of the two instruments, and put the time between them "
            "into the name map"
        )
    else:
        text = f"{row.channel} is {measured} (standard error {1e3 * row.stderr:.1f} ms); {allowed}"
        line = add_delay_line(record, row.channel, delay=row.delay)
        remedy = f"{line}, and the same delay for the other channels of that instrument"
    return Finding("warning", "lag", (row.channel,), text=text, remedy=remedy, evidence=evidence)


def _allowed_delays(channel: str, specification: Instruments | None) -> tuple[float, float, str]:
    """Return the range of delays without a finding [s], and the words for it."""
    if specification is not None:
        instrument = specification.of(channel)
        for prior in (instrument.delay, instrument.lag):
            if prior is not None:
                mean, sigma = prior
                low = min(0.0, mean - _SIGMAS * sigma) - FAST
                return low, mean + _SIGMAS * sigma + FAST, "the aircraft file allows"
    limit = FAST
    if channel in _SLOW_CHANNELS:
        limit = SLOW
    return -limit, limit, "the usual range is"


def _stretch_delays(
    reference: np.ndarray, late: np.ndarray, mask: np.ndarray, step: float
) -> list[Delay]:
    """Return the delays of single stretches in which the two signals differ in time only."""
    delays = []
    for stretch in _stretches(mask, late, step):
        try:
            delay = time_delay(reference[stretch], late[stretch], step, _SEARCHED)
        except IdentificationError:
            continue
        if delay.correlation > _SHARE:
            delays.append(delay)
    return delays


def _stretches(mask: np.ndarray, motion: np.ndarray, step: float) -> list[slice]:
    """Return the stretches of the mask with the most motion, each at most a minute long."""
    longest = round(_LONGEST / step)
    stretches = []
    for start, stop in true_runs(mask):
        for first in range(start, stop, longest):
            last = min(first + longest, stop)
            if last - first >= _LEAST_SAMPLES:
                stretches.append(slice(first, last))
    stretches.sort(key=lambda stretch: -float(np.var(motion[stretch])))
    return stretches[:_MOST_STRETCHES]


def _pool_delays(delays: list[Delay]) -> tuple[float, float, float, bool]:
    """Return the mean delay, its standard error, the median correlation, and whether it is a bound.

    The mean is weighted. The scatter inflates its standard error (Birge ratio).
    """
    correlation = float(np.median([delay.correlation for delay in delays]))
    inside = [delay for delay in delays if not delay.bound]
    if 2 * len(inside) < len(delays):
        bounds = [delay.estimate for delay in delays if delay.bound]
        return min(bounds, key=abs), np.inf, correlation, True
    values = np.array([delay.estimate for delay in inside])
    errors = np.maximum(np.array([delay.stderr for delay in inside]), _LEAST_STDERR)
    weight = errors**-2 / np.sum(errors**-2)
    mean = float(weight @ values)
    birge = np.sqrt(np.sum(((values - mean) / errors) ** 2) / max(len(values) - 1, 1))
    stderr = float(max(1.0, birge) / np.sqrt(np.sum(errors**-2)))
    return mean, stderr, correlation, False


SCALE = 0.005  # deviation of a slope from one above which it is a note
GROSS_SCALE = 0.1  # deviation of a slope from one above which it is a warning
_STRAIGHT = 0.9995  # correlation above which a slope of half a per cent is informative
# Standard errors of a slope that matters. They are wide, because few manoeuvres determine a slope.
_CERTAIN = 2.5
_SECONDS = 5.0  # of one block of the standard error of a slope
# Relation -> channels in the finding on its slope.
_SCALED = {
    "phi_rate": ("phi", "p"),
    "theta_rate": ("theta", "q"),
    "psi_rate": ("psi", "r"),
    "climb_rate": ("hdot", "h_baro"),
    "vane": ("alpha_vane",),
}
_COLUMNS = (
    "relation",
    "title",
    "units",
    "disagreement",
    "limit",
    "consistent",
    "moving",
    "varies",
    "correlation",
    "slope",
    "slope_stderr",
    "offset",
    "rms",
)
_UPWASH = (0.8, 1.35)  # slopes of a vane that are not a warning
_VANE_CORRELATION = 0.9  # above which the slope of a vane is informative
_VANE_SLOPE = 0.02  # deviation of the slope of a vane from one that is reported
_OUTSIDE = 0.001  # share of samples outside the plausible range that is reported


def kinematic_table(signals: ResampledChannels) -> pd.DataFrame:
    """Return the agreement of the two sides of every relation.

    Parameters
    ----------
    signals : ResampledChannels
        Without mistakes, sensors at the c.g.

    Returns
    -------
    DataFrame
        ``relation title units disagreement limit consistent moving varies correlation slope
        slope_stderr offset rms``. The slope is of the first side over the second. Its standard
        error follows from blocks of five seconds. Offset and rms difference are in `units`.
    """
    rows = []
    for name, check in compare_all(signals).items():
        difference = (check.first - check.second)[check.mask]
        rows.append(
            {
                "relation": name,
                "title": check.relation.title,
                "units": check.relation.units,
                "disagreement": check.disagreement,
                "limit": check.relation.limit,
                "consistent": check.consistent,
                "moving": check.moving,
                "varies": check.varies,
                "correlation": check.correlation,
                "slope": check.slope,
                "slope_stderr": _slope_error(check, signals.step),
                "offset": check.offset,
                "rms": float(np.std(difference)),
            }
        )
    return pd.DataFrame(rows, columns=_COLUMNS)


def kinematic_findings(
    explanations: list[Explanation],
    comparisons: dict[str, RelationCheck],
    signals: ResampledChannels,
    record: xr.DataTree,
) -> list[Finding]:
    """Return findings on mistakes, on unresolved relations, and on implausible values."""
    findings = [_mistake_finding(explanation, record) for explanation in explanations]
    for name, check in comparisons.items():
        if check.consistent:
            continue
        channels = check.relation.channels(signals)
        text = (
            f"{check.relation.title} do not agree (disagreement {check.disagreement:.2f}), and no "
            f"single sign, unit or axis resolves it"
        )
        remedy = f"check {', '.join(channels)}; see the plot of {name}"
        evidence = {"relation": name}
        findings.append(
            Finding(
                "warning", "inconsistent", channels, text=text, remedy=remedy, evidence=evidence
            )
        )
    for name in signals.values:
        findings += _range_findings(name, signals, record)
    return findings


def accuracy_findings(table: pd.DataFrame) -> list[Finding]:
    """Return findings on scale errors of channels that agree otherwise, and on vane upwash."""
    findings = []
    for row in iterate_rows(table):
        if row.relation not in _SCALED or not row.consistent:
            continue
        if row.relation == "vane":
            if row.moving:
                findings += _vane_findings(row)
            continue
        deviation = abs(row.slope - 1.0)
        is_certain = deviation > SCALE and deviation > _CERTAIN * row.slope_stderr
        if row.correlation > _STRAIGHT and is_certain:
            findings.append(_scale_finding(row, deviation))
    return findings


def _scale_finding(row, deviation: float) -> Finding:
    names = _SCALED[row.relation]
    severity = "note"
    if deviation > GROSS_SCALE:
        severity = "warning"
    text = (
        f"{row.title}: the first is {row.slope:.3f} of the second (standard error "
        f"{row.slope_stderr:.3f})"
    )
    remedy = f"a scale error of {' or '.join(names)}: let the reconstruction find it, or calibrate"
    evidence = {"slope": row.slope, "stderr": row.slope_stderr}
    return Finding(severity, "scale", names, text=text, remedy=remedy, evidence=evidence)


def _vane_findings(row) -> list[Finding]:
    limit = max(_VANE_SLOPE, _CERTAIN * row.slope_stderr)
    if row.correlation < _VANE_CORRELATION or not abs(row.slope - 1.0) > limit:
        return []
    severity, cause = "warning", "upwash and offset"
    if _UPWASH[0] < row.slope < _UPWASH[1]:
        severity = "note"
    elif not row.varies:
        severity = "note"
        cause += ", or wind and sideslip, which make changes as small as these"
    text = (
        f"alpha_vane shows {row.slope:.2f} of the angle that attitude and climb give "
        f"(standard error {row.slope_stderr:.2f}), "
        f"mean difference {np.degrees(row.offset):+.1f} deg: {cause}"
    )
    remedy = (
        "give factor and bias_sigma of the vane in the aircraft file; the reconstruction "
        "estimates them"
    )
    evidence = {"slope": row.slope, "offset": row.offset}
    return [
        Finding(severity, "scale", ("alpha_vane",), text=text, remedy=remedy, evidence=evidence)
    ]


def _mistake_finding(explanation: Explanation, record: xr.DataTree) -> Finding:
    repair = explanation.repair
    # disagreement of each relation before and after the repair
    changes = {}
    resolved = []
    for name, before, after in zip(
        explanation.resolves, explanation.before, explanation.after, strict=True
    ):
        changes[name] = (before, after)
        resolved.append(f"{name} {before:.2f} to {after:.2f}")
    alternatives = [alternative.mistake for alternative in explanation.instead]
    suffix = "".join(f"; or {mistake}" for mistake in alternatives)
    text = f"{repair.mistake}{suffix} (disagreements that this resolves: {', '.join(resolved)})"
    if repair.kind == "axis":
        remedy = exchange_channels(record, *repair.channels)
    else:
        lines = []
        for name in repair.channels:
            lines.append(map_entry(record, name, slope=repair.slope, shift=repair.shift))
        remedy = "\n    ".join(lines)
    evidence = {"resolves": changes, "instead": alternatives}
    return Finding(
        "error", repair.kind, repair.channels, text=text, remedy=remedy, evidence=evidence
    )


def _range_findings(name: str, signals: ResampledChannels, record: xr.DataTree) -> list[Finding]:
    """Return a finding on values outside the plausible range of a channel."""
    limits = plausible_range(name)
    good = signals.good[name] & signals.flying
    if limits is None or not good.any():
        return []
    low, high = limits
    if name in WRAPPED and _is_recorded_within(record, name, low, high):
        return []  # the signal is the angle after several turns
    x = signals[name][good]
    outside = (x < low) | (x > high)
    if outside.mean() < _OUTSIDE:
        return []
    # A wrong unit explains the range if all values are plausible in another unit.
    for wrong, right, factor in units_mistaken(name):
        if low < factor * x.min() and factor * x.max() < high:
            text = (
                f"{name} is in {wrong} and was taken as {right}: it reaches "
                f"{np.abs(x).max():.4g} {right}, which is not possible"
            )
            line = map_entry(record, name, factor)
            return [Finding("error", "unit", (name,), text=text, remedy=line)]
    worst = float(x[np.argmax(np.abs(x - np.clip(x, low, high)))])
    text = (
        f"{name} reaches {worst:.4g}; possible are {low:g} to {high:g} (SI); "
        f"{outside.mean():.1%} of the flight lies outside"
    )
    remedy = "check unit, scale and column of the name map"
    evidence = {"worst": worst}
    return [Finding("error", "range", (name,), text=text, remedy=remedy, evidence=evidence)]


def _is_recorded_within(record: xr.DataTree, name: str, low: float, high: float) -> bool:
    """Return whether all recorded samples of a channel lie within limits. [SI]"""
    x = record[map_entry_of(record, name)[0]].to_dataset()[name].values
    return bool(np.nanmin(x) >= low and np.nanmax(x) <= high)


def _slope_error(check: RelationCheck, step: float) -> float:
    """Return the standard error of a slope, from the scatter between blocks of the record."""
    y = check.first[check.mask] - check.first[check.mask].mean()
    x = check.second[check.mask] - check.second[check.mask].mean()
    width = max(round(_SECONDS / step), 1)
    blocks = max(len(y) // width, 1)
    # sandwich formula: the sums of x times residual over blocks are independent
    products = (x * (y - check.slope * x))[: blocks * width]
    sums = products.reshape(blocks, -1).sum(axis=1)
    variance = (sums**2).sum() * blocks / max(blocks - 1, 1)
    return float(np.sqrt(variance) / max((x**2).sum(), 1e-30))
