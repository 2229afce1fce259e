"""Half widths of a band and the judgement of a time history or of one number.

The band belongs to the flight value at its time.  No signal is shifted in time or to the start
value of the flight (rule R17 of the tolerance table).  A trim residual and a delay therefore use up
tolerance.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import numpy as np

from flightmech.names import WRAPPED, unit_suffix
from flightmech.support.arrays import median, rms
from pom.tolerances.channels import display_unit, limit_to_si_factor
from pom.tolerances.criteria import Criterion

ALLOWED = "; allowed: "
"""Text between a trim beyond its limit and the reason of the case file (``trim_allowed``)."""


@dataclass(frozen=True)
class RowRemark:
    """One remark on a row of the verdict table.

    Attributes
    ----------
    kind : str
        ``reason`` (reason why a row is not judged), ``failure`` (of the run of the model),
        ``values`` (of flight and model), ``cycles``, ``no_mode``, ``stability``, ``bank``,
        ``window`` (a figure of the flight that depends on the length of the window), ``outside``,
        ``steady``, ``method``, ``span``, ``event``, ``trend``, ``tick``, ``lacking``,
        ``precondition``, ``certified``, ``no_value`` (a sample is NaN), ``trim`` (a trim quantity
        beyond its limit), ``trim_allowed`` (the same, allowed by the case file), ``trim_surface``
        (a trim surface that the trim solved for), ``tables_left``, ``envelope_left`` (beyond the
        validity envelope), ``low_confidence`` (where no flight supports the model),
        ``below_runway``, ``waived`` (inputs that the model does not have), ``record`` (an error of
        the flight record), ``watch`` (a channel without a tolerance beyond its band), ``evidence``
        (distance from the flight estimates), ``no_evidence`` (a model without terms to compare),
        ``far_from_evidence`` (terms beyond three standard errors), ``edited_evidence`` (terms of
        the evidence that are edited), ``departure`` (from the printed row or from normal practice),
        ``not_checked`` (a condition of the row), ``additional`` (the case is not the test of its
        row), ``record_warning`` (on the flight record), ``probe`` (answer of the model to changed
        inputs, and its scatter), ``not_driven`` (an answer that the inputs do not drive), ``leak``
        (samples of the record identified the model), ``device`` (recording of a device and its
        inputs), ``recurrent`` and ``recurrent_beyond`` (comparison with a master run),
        ``without_effect`` (a device that no term uses), ``row`` (note of the tolerance table),
        ``note`` (text of a report from before remarks had kinds).
    text : str
        The remark for a reader, with its numbers.
    quantity : str
        Signal or measure of the remark; empty for the whole row.
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
    >>> cycles = RowRemark("cycles", "6.2 cycles", values={"flight": 6.2}, unit="1")
    >>> remarks_text([cycles, RowRemark("stability", "stability differs")])
    '6.2 cycles; stability differs'
    """
    return "; ".join(remark.text for remark in remarks)


def reason_remarks(text: str) -> tuple[RowRemark, ...]:
    """Return the remark on a row that is not judged."""
    return (RowRemark("reason", text),)


def row_remarks(row: Mapping[str, Any]) -> tuple[RowRemark, ...]:
    """Return the remarks of a stored row.

    A row of an older report has one text, its ``note``.
    """
    if "remarks" in row:
        return tuple(map(_as_remark, row["remarks"]))
    if row.get("note"):
        return (RowRemark("note", row["note"]),)
    return ()


def _as_remark(item: RowRemark | Mapping[str, Any]) -> RowRemark:
    if isinstance(item, RowRemark):
        return item
    return RowRemark(**item)


NAN = float("nan")
ROUNDING = 1e-9
"""Ratio above 1 that still passes: the conversion from degrees to radians and back rounds.

A difference that equals the printed tolerance therefore passes.
"""
_TIME_ROUNDING = 1e-9  # [s] a sample at a bound of a window may be off by a rounding error


class NotJudged(Exception):
    """A criterion cannot be judged; the text is the reason.

    It becomes a verdict, not an error for the user.
    """


class Invalid(Exception):
    """The data do not permit a judgement; the text is the reason.

    It becomes a verdict, not an error for the user.
    """


class NoValue(Invalid):
    """A sample in the window is not finite.

    The criterion fails, and no alternative of its group replaces it.
    """


@dataclass(frozen=True)
class Judgement:
    """Judgement of one criterion on one model, in SI; times on the clock of the record.

    ``flight`` and ``model`` are the values of a scalar measure.  ``applied`` is the tolerance as
    applied.  ``rms`` is the root mean square of difference over half width, for a measure with many
    samples.
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

    @property
    def fails_without_ratio(self) -> bool:
        """Whether it fails for a reason that no finite ratio shows, such as a missing mode."""
        return self.verdict == "fail" and not 1.0 < self.worst_ratio < math.inf


def half_width(criterion: Criterion, flight: np.ndarray | float, cycle: int = 0) -> np.ndarray:
    """Return the half width at every flight value.

    Parameters
    ----------
    criterion : Criterion
        Printed band, and the share of it that is applied.
    flight : array (time,) or float
        Flight values of the window, or the flight value of a scalar measure.  If the percentage is
        of the first overshoot, its value. [SI]
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
        The case does not give the base of the percentage.
    """
    magnitude = np.abs(np.atleast_1d(np.asarray(flight, float)))
    widths = []
    for limit in criterion.band.limits:
        if limit.quantity == "absolute":
            factor = limit_to_si_factor(criterion.measure, criterion.channel, limit.unit)
            widths.append(np.full_like(magnitude, limit.value * factor))
        elif limit.quantity == "percent":
            widths.append(limit.value / 100.0 * _percentage_base(criterion, magnitude))
        elif limit.quantity == "percent_times_n_plus_1":
            widths.append(limit.value / 100.0 * (cycle + 1) * magnitude)
        else:
            raise NotJudged(f"a limit of kind {limit.quantity} has no width")
    if not widths:
        raise NotJudged("the row prints no width")
    # A single limit is its own greater and lesser one.
    if criterion.band.rule == "lesser_of":
        return criterion.fraction * np.min(widths, axis=0)
    return criterion.fraction * np.max(widths, axis=0)


def _percentage_base(criterion: Criterion, magnitude: np.ndarray) -> np.ndarray:
    """Return the value of which a percentage is taken, at every sample. [SI]"""
    if criterion.band.base == "ref_peak":
        return np.full_like(magnitude, magnitude.max())
    if criterion.band.base != "range_max":
        return magnitude
    # Rule R3: a lone percentage is of the largest value in service, which no record contains.
    if criterion.largest is None:
        raise NotJudged(
            f"the percentage is of the largest value in service; give that of "
            f"{criterion.channel} in [ranges]"
        )
    return np.full_like(magnitude, abs(criterion.largest))


def applied_tolerance(criterion: Criterion, widths: np.ndarray, flight: np.ndarray | float) -> str:
    """Return the tolerance as applied: share, base of the percentage and half width.

    Examples
    --------
    ``10 % of the flight value (38 s): 3.8 s``; ``20 % of 2 deg/s: 0.4 deg/s``; ``1.5 deg`` for a
    plain width.
    """
    unit = display_unit(criterion)
    factor = limit_to_si_factor(criterion.measure, criterion.channel, unit)
    low, high = float(np.min(widths)) / factor, float(np.max(widths)) / factor
    number = f"{low:.4g} ... {high:.4g}"
    if high - low <= 1e-6 * high:
        number = f"{low:.4g}"
    # A percentage of the local flight value has no single base.
    base = np.max(np.abs(flight))
    if criterion.band.base == "range_max":
        base = criterion.largest
    elif criterion.band.base == "ref_local":
        base = None
    printed = criterion.band.text
    if base is not None and "%" in printed:
        printed = f"{printed} ({float(base) / factor:.4g}{unit_suffix(unit)})"
    share = ""
    if criterion.fraction != 1.0:
        share = f"{100.0 * criterion.fraction:g} % of: "
    width = f"{number}{unit_suffix(unit)}"
    # a plain width is not repeated
    if share + printed == width:
        return width
    return f"{share}{printed}: {width}"


def inside_window(time: np.ndarray, window: tuple[float, float]) -> np.ndarray:
    """Return the mask of the samples in a window (time,).

    Raises
    ------
    Invalid
        Time does not rise, or the window exceeds the samples by more than one step.
    """
    steps = np.diff(time)
    if not steps.size or not (steps > 0.0).all():
        raise Invalid("time does not rise from sample to sample")
    start, stop = window
    missing = max(time[0] - start, stop - time[-1])
    # The median is computed only if it is needed: this function runs for every criterion.
    if missing > 0.0 and missing > np.median(steps):
        raise Invalid(
            f"samples cover {time[0]:.2f} ... {time[-1]:.2f} s, the window is {start:.2f} "
            f"... {stop:.2f} s"
        )
    return (time >= start - _TIME_ROUNDING) & (time <= stop + _TIME_ROUNDING)


def demand_finite(who: str, time: np.ndarray, values: np.ndarray) -> None:
    """Raise `NoValue` if a value is not finite."""
    bad = ~np.isfinite(values)
    if bad.all():
        raise NoValue(f"{who} has no value in the window")
    if bad.any():
        raise NoValue(
            f"{who} has no value in {int(bad.sum())} of {bad.size} samples, first at "
            f"{time[bad][0]:.2f} s"
        )


def unwrapped_difference(channel: str, flight: np.ndarray, model: np.ndarray) -> np.ndarray:
    """Return model minus flight (time,); NaN where one of them is not finite.

    Angles that jump by a full turn are unwrapped.  Their first difference is below half a turn.
    """
    if channel not in WRAPPED:
        return model - flight
    error = np.asarray(model - flight, float)
    known = np.isfinite(error)
    if not known.any():
        return error
    # a sample without a value would make all later ones NaN
    smooth = np.unwrap(model[known]) - np.unwrap(flight[known])
    # remove whole turns from the first difference, and the same turns from all others
    error[known] = smooth - 2.0 * np.pi * np.round(smooth[0] / (2.0 * np.pi))
    return error


class AppliedBand(NamedTuple):
    """The band about a flight.

    Attributes
    ----------
    width : array (time,)
        Half width. [SI]
    least : float
        Smallest half width. [SI]
    step : float
        Median time step. [s]
    text : str
        The tolerance as applied.
    """

    width: np.ndarray
    least: float
    step: float
    text: str


def applied_band(criterion: Criterion, time: np.ndarray, flight: np.ndarray) -> AppliedBand:
    """Return the band about the samples of a flight (time,) [s, SI]; errors as `half_width`."""
    width = half_width(criterion, flight)
    step = 0.0
    if time.size > 1:
        step = median(np.diff(time))
    text = applied_tolerance(criterion, width, flight)
    return AppliedBand(width, float(width.min()), step=step, text=text)


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
        Flight samples that the criterion counts, rising. [s]
    flight, model : array (time,)
        Values at these samples, finite. [SI]
    band : AppliedBand, optional
        Result of `applied_band`, which is the same for all models.

    Raises
    ------
    NotJudged
        See `half_width`.
    """
    band = band or applied_band(criterion, time, flight)
    error = unwrapped_difference(criterion.channel, flight, model)
    ratio = band_ratios(error, band.width)
    outside = ratio > 1.0 + ROUNDING
    worst = int(np.argmax(ratio))
    verdict, first_exit = "pass", NAN
    remarks: tuple[RowRemark, ...] = ()
    if outside.any():
        verdict, first_exit = "fail", float(time[outside][0])
        remarks = (_outside_remark(_longest_run(outside) * band.step),)
    return Judgement(
        verdict=verdict,
        width=band.least,
        worst=float(error[worst]),
        worst_ratio=float(ratio[worst]),
        at=float(time[worst]),
        first_exit=first_exit,
        inside=float(1.0 - outside.mean()),
        remarks=remarks,
        applied=band.text,
        rms=rms(ratio),
    )


def band_ratios(error: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Return |difference| over half width; a zero difference is inside a band of any width."""
    # a percentage of zero gives a width of zero
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(error == 0.0, 0.0, np.abs(error) / width)


def _outside_remark(longest: float) -> RowRemark:
    text = f"longest run outside {longest:.2f} s"
    return RowRemark("outside", text, values={"longest": longest}, unit="s")


def _longest_run(outside: np.ndarray) -> int:
    """Return the number of samples in the longest run outside; at least one is outside."""
    # With a false sample at both ends, every run has a rising and a falling edge.
    padded = np.zeros(outside.size + 2, bool)
    padded[1:-1] = outside
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
    """Judge one number of the model against the number of the flight.

    Parameters
    ----------
    criterion : Criterion
    flight, model : float
        Values of the measure. [SI]
    at : float
        Time of the number. [s]
    remarks : tuple of RowRemark
    base : float, optional
        Base of the percentage; default: the flight value. [SI]
    cycle : int
        As in `half_width`.
    """
    if base is None:
        base = flight
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
