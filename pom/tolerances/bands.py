"""Half widths of a band and the judgement of a time history or of one number.

The band belongs to the flight value at its time.  Nothing is shifted in time, nothing is re-centred
on the start value of the model (rule R17 of the tolerance table): a trim residual and a delay use
up tolerance.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import numpy as np

from flightmech.support.arrays import median, rms
from pom.tolerances.channels import WRAPPED, display_unit, limit_to_si_factor
from pom.tolerances.criteria import Criterion

ALLOWED = "; allowed: "
"""Joins a trim beyond its limit and the reason of the case file, in a remark ``trim_allowed``."""


@dataclass(frozen=True)
class RowRemark:
    """One remark on a row of the verdict table.

    Attributes
    ----------
    kind : str
        ``reason`` (why a row is not judged), ``failure`` (of the model's run), ``values`` (what
        flight and model have), ``cycles``, ``no_mode``, ``stability``, ``bank``, ``window`` (a
        figure of the flight that a shorter window moves), ``outside``, ``steady``, ``method``,
        ``span``, ``event``, ``trend``, ``tick``, ``lacking``, ``precondition``, ``certified``,
        ``no_value`` (a sample without a number), ``trim`` (a trim quantity beyond its limit),
        ``trim_allowed`` (the same, allowed by the case file), ``trim_surface`` (a trim surface that
        was solved for), ``tables_left``, ``waived`` (what the model does without), ``record`` (an
        error that a check found in the flight record), ``watch`` (a channel without a tolerance
        that is off), ``evidence`` (distance of the model from what flight found),
        ``far_from_evidence`` (terms beyond three standard errors of it), ``row`` (note of the
        tolerance table), ``note`` (text of a report that was written before remarks had kinds).
    text : str
        The remark for a reader, with its numbers.
    quantity : str
        Signal or measure it is about; empty for the whole row.
    values : mapping of str to float
        The numbers of the text at full precision, by name: ``flight``, ``model``, ``limit`` ...
    unit : str
        Unit of all `values`; ``1`` for ratios and counts, empty without values.
    """

    kind: str
    text: str
    quantity: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    unit: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return all fields."""
        return asdict(self)


def remarks_text(remarks: Iterable[RowRemark]) -> str:
    """Return remarks as one text.

    Examples
    --------
    >>> remarks_text([RowRemark("cycles", "6.2 cycles", values={"flight": 6.2}, unit="1"), RowRemark("stability", "stability differs")])
    '6.2 cycles; stability differs'
    """
    return "; ".join(remark.text for remark in remarks)


def reason_remarks(text: str) -> tuple[RowRemark, ...]:
    """Return the remark on a row that is not judged."""
    return (RowRemark("reason", text),)


def row_remarks(row: Mapping[str, Any]) -> tuple[RowRemark, ...]:
    """Return the remarks of a stored row; that of an older report has one text, its ``note``."""
    if "remarks" in row:
        return tuple(
            item if isinstance(item, RowRemark) else RowRemark(**item) for item in row["remarks"]
        )
    return (RowRemark("note", row["note"]),) if row.get("note") else ()


NAN = float("nan")
ROUNDING = (
    1e-9  # degrees to radians and back: a difference equal to the tolerance as printed passes
)


class NotJudged(Exception):
    """A criterion cannot be judged; the text states why.  Ends as a verdict, never at the user as
    an error.
    """


class Invalid(Exception):
    """The data cannot carry a judgement; the text states why.  Ends as a verdict, never at the user
    as an error.
    """


class NoValue(Invalid):
    """A sample in the window is not a number: no alternative of the group can make up for it."""


@dataclass(frozen=True)
class Judgement:
    """Judgement of one criterion on one model, in SI; times on the clock of the record.

    ``flight`` and ``model`` are the values of a measure that is one number; ``applied`` the
    tolerance as applied; ``rms`` the root mean square of difference over half width of a measure
    that has many samples.
    """

    verdict: str
    width: float = NAN
    worst: float = NAN
    worst_ratio: float = NAN
    at: float = NAN
    first_exit: float = NAN
    inside: float = NAN
    remarks: tuple[RowRemark, ...] = ()
    flight: float = NAN
    model: float = NAN
    applied: str = ""
    rms: float = NAN


def half_width(criterion: Criterion, flight: np.ndarray | float, cycle: int = 0) -> np.ndarray:
    """Return the half width at every flight value.

    Parameters
    ----------
    criterion : Criterion
        Its band as printed and the share of it that is applied.
    flight : array (time,) or float
        Flight values of the window, or the flight value of a scalar measure (of the first overshoot
        where the percentage is of that). [SI]
    cycle : int
        Number n of the cycle, for a percentage that grows as n + 1.

    Returns
    -------
    array (time,)
        ``max`` of the limits for ``greater_of``, ``min`` for ``lesser_of``, times the fraction.
        [SI]

    Raises
    ------
    NotJudged
        The percentage is of something the case does not know.
    """
    magnitude = np.abs(np.atleast_1d(np.asarray(flight, float)))
    widths = []
    for limit in criterion.band.limits:
        if limit.quantity == "absolute":
            widths.append(
                np.full_like(
                    magnitude,
                    limit.value
                    * limit_to_si_factor(criterion.measure, criterion.channel, limit.unit),
                )
            )
        elif limit.quantity == "percent":
            widths.append(limit.value / 100.0 * _base(criterion, magnitude))
        elif limit.quantity == "percent_times_n_plus_1":
            widths.append(limit.value / 100.0 * (cycle + 1) * magnitude)
        else:
            raise NotJudged(f"a limit of kind {limit.quantity} has no width")
    if not widths:
        raise NotJudged("the row prints no width")
    joined = (
        np.min(widths, axis=0) if criterion.band.rule == "lesser_of" else np.max(widths, axis=0)
    )
    return criterion.fraction * joined


def _base(criterion: Criterion, magnitude: np.ndarray) -> np.ndarray:
    """Return what a percentage is of."""
    if criterion.band.base == "ref_peak":
        return np.full_like(magnitude, magnitude.max())
    if criterion.band.base != "range_max":
        return magnitude
    if (
        criterion.largest is None
    ):  # rule R3: a lone percentage is of the largest value in service, which no record holds
        raise NotJudged(
            f"the percentage is of the largest value in service; give that of "
            f"{criterion.channel} in [ranges]"
        )
    return np.full_like(magnitude, abs(criterion.largest))


def applied_tolerance(criterion: Criterion, widths: np.ndarray, flight: np.ndarray | float) -> str:
    """Return the tolerance as applied: its share, what the percentage is of, and the number that
    came out.

    Examples
    --------
    ``10 % of the flight value (38 s): 3.8 s``; ``20 % of 2 deg/s: 0.4 deg/s``; ``1.5 deg`` of a plain width.
    """
    unit = display_unit(criterion)
    size = limit_to_si_factor(criterion.measure, criterion.channel, unit)
    low, high = float(np.min(widths)) / size, float(np.max(widths)) / size
    number = f"{low:.4g}" if high - low <= 1e-6 * high else f"{low:.4g} ... {high:.4g}"
    base = {
        "ref_peak": np.max(np.abs(flight)),
        "range_max": criterion.largest,
        "ref_local": None,
    }.get(criterion.band.base, np.max(np.abs(flight)))
    words = criterion.band.text
    if base is not None and "%" in words:
        words = f"{words} ({float(base) / size:.4g}{_unit(unit)})"
    share = "" if criterion.fraction == 1.0 else f"{100.0 * criterion.fraction:g} % of: "
    came = f"{number}{_unit(unit)}"
    return came if share + words == came else f"{share}{words}: {came}"


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def inside_window(time: np.ndarray, window: tuple[float, float]) -> np.ndarray:
    """Return the mask of the samples in a window.

    Raises
    ------
    Invalid
        Time does not rise, or the samples end before the window does (by more than one step).
    """
    steps = np.diff(time)
    if not steps.size or not (steps > 0.0).all():
        raise Invalid("time does not rise from sample to sample")
    start, stop = window
    missing = max(time[0] - start, stop - time[-1])
    if missing > 0.0 and missing > np.median(steps):
        raise Invalid(
            f"samples cover {time[0]:.2f} ... {time[-1]:.2f} s, the window is {start:.2f} "
            f"... {stop:.2f} s"
        )
    return (time >= start - 1e-9) & (time <= stop + 1e-9)


def demand_finite(who: str, time: np.ndarray, values: np.ndarray) -> None:
    """Raise `NoValue` when `values` hold a NaN or an infinity."""
    bad = ~np.isfinite(values)
    if bad.all():
        raise NoValue(f"{who} has no value in the window")
    if bad.any():
        raise NoValue(
            f"{who} has no value in {int(bad.sum())} of {bad.size} samples, first at "
            f"{time[bad][0]:.2f} s"
        )


def unwrapped_difference(channel: str, flight: np.ndarray, model: np.ndarray) -> np.ndarray:
    """Return model minus flight; angles that wrap are unwrapped and start less than half a turn
    apart.
    """
    if channel not in WRAPPED:
        return model - flight
    error = np.unwrap(model) - np.unwrap(flight)
    return error - 2.0 * np.pi * np.round(error[0] / (2.0 * np.pi))


class AppliedBand(NamedTuple):
    """The band about a flight: half width (time,) [SI], the least of it, median step [s], the
    tolerance as applied in words.
    """

    width: np.ndarray
    least: float
    step: float
    text: str


def applied_band(criterion: Criterion, time: np.ndarray, flight: np.ndarray) -> AppliedBand:
    """Return the band about the samples of a flight (time,) [s, SI]; errors as `half_width`."""
    width = half_width(criterion, flight)
    step = median(np.diff(time)) if time.size > 1 else 0.0
    return AppliedBand(width, float(width.min()), step, applied_tolerance(criterion, width, flight))


def judge_trace(
    criterion: Criterion,
    time: np.ndarray,
    flight: np.ndarray,
    model: np.ndarray,
    band: AppliedBand | None = None,
) -> Judgement:
    """Judge a time history: every flight sample must lie within the half width.

    Parameters
    ----------
    criterion : Criterion
    time : array (time,)
        Flight samples that count, rising. [s]
    flight, model : array (time,)
        Values at these samples, finite. [SI]
    band : AppliedBand, optional
        That of `applied_band`, which is the same for all models.

    Raises
    ------
    NotJudged
        See `half_width`.
    """
    band = band or applied_band(criterion, time, flight)
    error = unwrapped_difference(criterion.channel, flight, model)
    ratio = band_ratios(error, band.width)
    out = ratio > 1.0 + ROUNDING
    worst = int(np.argmax(ratio))
    return Judgement(
        verdict="fail" if out.any() else "pass",
        width=band.least,
        worst=float(error[worst]),
        worst_ratio=float(ratio[worst]),
        at=float(time[worst]),
        first_exit=float(time[out][0]) if out.any() else NAN,
        inside=float(1.0 - out.mean()),
        remarks=_outside(_longest(out) * band.step) if out.any() else (),
        applied=band.text,
        rms=rms(ratio),
    )


def band_ratios(error: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Return |difference| over half width; no difference is inside, however narrow the band."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(error == 0.0, 0.0, np.abs(error) / width)


def _outside(longest: float) -> tuple[RowRemark, ...]:
    return (
        RowRemark(
            "outside", f"longest run outside {longest:.2f} s", values={"longest": longest}, unit="s"
        ),
    )


def _longest(out: np.ndarray) -> int:
    """Return the samples of the longest run outside, of one sample or more."""
    padded = np.zeros(out.size + 2, bool)
    padded[1:-1] = out
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return int((edges[1::2] - edges[::2]).max())


def judge_number(
    criterion: Criterion,
    flight: float,
    model: float,
    at: float = NAN,
    remarks: tuple[RowRemark, ...] = (),
    base: float | None = None,
    cycle: int = 0,
) -> Judgement:
    """Judge one number of the model against that of the flight.

    Parameters
    ----------
    criterion : Criterion
    flight, model : float
        [SI]
    at : float
        Time that the number belongs to. [s]
    remarks : tuple of RowRemark
    base : float, optional
        What the percentage is of, when it is not the flight value. [SI]
    cycle : int
        As in `half_width`.
    """
    base = flight if base is None else base
    width = half_width(criterion, base, cycle)
    error = model - flight
    ratio = float(band_ratios(np.array([error]), width)[0])
    return Judgement(
        verdict="pass" if ratio <= 1.0 + ROUNDING else "fail",
        width=float(width[0]),
        worst=error,
        worst_ratio=ratio,
        at=at,
        remarks=remarks,
        flight=flight,
        model=model,
        applied=applied_tolerance(criterion, width, base),
    )
