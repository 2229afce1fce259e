"""Runs that are recorded, not flown: results of a device, and runs of an earlier report.

A qualification test guide holds the results of the device.  Its host records a run that is driven
by the inputs of the flight; the recording is judged as the output of a model is.  Recurrent tests
compare a run with the same run of the first report, the master.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import flighttest
from flightmech.errors import OutOfRange, ParseError, SchemaError
from flightmech.names import WRAPPED
from flightmech.quantities import time_text
from flightmech.support.input_files import file_sha256
from pom.cases.case import PomCase
from pom.cases.job import ReplayJob
from pom.judging.signals import signals_of_run, traces_of
from pom.judging.verdict import judge_all
from pom.probing.scatter_probe import measure_scatter
from pom.replaying.recordings.device_inputs import compare_inputs
from pom.replaying.recordings.recording_sizes import size_remarks
from pom.replaying.replay_channels import judged_channels, sampled_channels
from pom.replaying.result_assembly import assemble_result
from pom.result import PomResult, make_verdict_table
from pom.status import PASSED, unprobed_remark
from pom.tolerances.bands import RowRemark
from pom.tolerances.channels import output_of, plain_words

SAME_FLIGHT = 0.1
"""Tolerances by which two reconstructions of one flight may differ; our number."""
OF_EARLIER = "of an earlier report"  # words of the source of a master
RECORDING = "recording of a device"  # words of the source of a recording
GAP = 0.25  # [s] a longer gap of a recording is not bridged


@dataclass(frozen=True)
class RecordedRun:
    """One recorded run of a case.

    Attributes
    ----------
    channels : dict of str to tuple of array (time,)
        Clock and values by canonical name, on the clock of the flight record. [s, SI]
    origin : str
        File and hash, as in the attributes of a result.
    source : str
        What the run is, for its page: file, rate and shift of the clock.
    has_inputs : bool
        Whether the recording should hold the inputs that drove it: a run of an earlier report
        has none.
    """

    channels: Mapping[str, tuple[np.ndarray, np.ndarray]]
    origin: str
    source: str
    has_inputs: bool = True


@dataclass(frozen=True)
class MasterRun:
    """The run of an earlier report with which a run is compared.

    Attributes
    ----------
    name : str
        Name of the line.
    run : RecordedRun
    share : float
        Criterion: share of each tolerance, about the master. [1]
    remarks : tuple of str
        What is different between the two reports.
    flight : RecordedRun or None
        The flight that the earlier report judged the master by.
    """

    name: str
    run: RecordedRun
    share: float
    remarks: tuple[str, ...] = ()
    flight: RecordedRun | None = None


@dataclass(frozen=True)
class RecordedRuns:
    """Recorded runs of one case by name, and the masters by the run that they are compared with."""

    runs: Mapping[str, RecordedRun] = field(default_factory=dict)
    masters: Mapping[str, MasterRun] = field(default_factory=dict)


def read_recording(
    path: str | Path,
    case: PomCase,
    names: str | Path | None = None,
    start: float | None = None,
) -> RecordedRun:
    """Read the recording of a device for one case.

    Parameters
    ----------
    path : path
        File of any format of `flighttest.read`, with outputs at the centre of gravity.
    case : PomCase
    names : path, optional
        Name map of the recording (`flighttest.read`).
    start : float, optional
        Instant of the recording at the start of the window of the case.  Default: both clocks are
        one. [s]

    Raises
    ------
    ParseError, UnknownName, UnitError, SchemaError
        As `flighttest.read`, or the recording has none of the judged channels.
    OutOfRange
        The recording does not cover the window of the case.
    """
    digest = file_sha256(path)
    try:
        record = flighttest.read(path, names)
    except ParseError as error:
        if error.line:
            raise
        # A file of another kind: the caller may have meant a model.
        expected = f"an FMU, or the results of a device: {error.expected}"
        raise ParseError(str(path), 0, error.found, expected) from error
    shift = 0.0 if start is None else case.window[0] - start
    channels: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for node in map(xr.DataTree.to_dataset, record.children.values()):
        time = node["time"].values.astype(float) + shift
        for name, item in node.data_vars.items():
            if item.dims == ("time",):
                channels[str(name)] = (time, item.values.astype(float))
    _demand_judged(path, case, channels)
    step = _demand_cover(path, case, [time for time, _ in channels.values()])
    name = Path(path).name
    source = f"{RECORDING}, {name}, {1.0 / step:.4g} Hz"
    if shift:
        source += f", its clock {shift:+.4g} s is that of the flight record"
    return RecordedRun(channels, f"{name}, recording, sha256 {digest}", source)


def _demand_judged(path: str | Path, case: PomCase, channels: Collection[str]) -> None:
    """Raise if a recording has none of the judged channels of a case."""
    # the curves of a demonstration are shown and not judged
    judged = case.show if case.is_demonstration else judged_channels(case)
    if not any(output_of(name, channels) in channels for name in judged):
        raise SchemaError(
            f"recording {path}",
            [
                f"none of the judged channels of case {case.name} ({', '.join(judged)}) is among "
                f"{', '.join(sorted(channels)) or 'its channels'}; map their columns in the table "
                f"of names"
            ],
        )


def _demand_cover(path: str | Path, case: PomCase, clocks: Sequence[np.ndarray]) -> float:
    """Return the largest time step of a recording that covers the window of a case. [s]"""
    first, last = max(time[0] for time in clocks), min(time[-1] for time in clocks)
    step = max(float(np.median(np.diff(time))) for time in clocks if time.size > 1)
    if first > case.window[0] + step or last < case.window[1] - step:
        raise OutOfRange(
            f"recording {path}: its channels cover {time_text(first, 4)} ... {time_text(last, 4)} "
            "s on the clock of "
            f"the flight record, case {case.name} has {time_text(case.window[0])} ... "
            f"{time_text(case.window[1])} s; "
            f"give the instant of the recording at the start of the window (--start NAME=SECONDS), "
            f"or a longer recording"
        )
    return step


def resample_run(run: RecordedRun, time: np.ndarray) -> dict[str, np.ndarray]:
    """Return the channels of a run at other instants (time,), NaN in gaps and beyond the ends."""
    sampled = {}
    for name, (clock, recorded) in run.channels.items():
        good = np.isfinite(recorded)
        if good.sum() < 2:
            continue
        clock, values = clock[good], recorded[good]
        if name in WRAPPED:
            values = np.unwrap(values)
        step = float(np.median(np.diff(clock)))
        result = np.interp(time, clock, values)
        after = np.clip(np.searchsorted(clock, time), 1, clock.size - 1)
        is_gap = clock[after] - clock[after - 1] > max(GAP, 1.5 * step)
        # a sample of the recording itself needs no bridge
        is_gap &= np.abs(time - clock[after]) > 1e-9
        is_gap &= np.abs(time - clock[after - 1]) > 1e-9
        is_out = (time < clock[0] - step) | (time > clock[-1] + step)
        sampled[name] = np.where(is_gap | is_out, np.nan, result)
    return sampled


def add_recorded_runs(
    result: PomResult,
    states: xr.Dataset,
    job: ReplayJob,
    recorded: RecordedRuns | None,
    refusal: str = "",
) -> PomResult:
    """Return a result with its recorded runs judged, and compared with their masters.

    Parameters
    ----------
    result : PomResult
        Of the models that were flown; it may have none.
    states, job
        As in `pom.replaying.replay_case.ReplayPlan`.
    recorded : RecordedRuns or None
    refusal : str
        Why the flight cannot judge a run, as in `pom.replaying.replay_case.ReplayPlan`.
    """
    if recorded is None:
        return result
    outputs: dict[str, dict[str, np.ndarray]] = {}
    remarks: dict[str, tuple[RowRemark, ...]] = {}
    runs = dict(recorded.runs)
    for master in recorded.masters.values():
        runs[master.name] = master.run
    flight = signals_of_run(result.case, sampled_channels(states), job.time)
    for name, run in runs.items():
        if refusal:
            outputs[name] = {}
            continue
        outputs[name] = resample_run(run, job.time)
        remarks[name] = (RowRemark("device", run.source),)
        if run.has_inputs:
            remarks[name] += (
                *compare_inputs(job, outputs[name]),
                *size_remarks(flight, outputs[name], job.needed_inputs),
            )
    added = assemble_result(
        result.case,
        states,
        job=job,
        outputs_by_run=outputs,
        failures=dict.fromkeys(runs, refusal),
        attrs={f"model.{name}": run.origin for name, run in runs.items()},
        more=remarks,
    )
    joined = _join_results(result, added)
    if refusal:
        return joined
    found: dict[str, tuple[RowRemark, ...]] = {}
    for name, run in recorded.runs.items():
        # a device cannot fly again, but its answer does not hold the noise of the record either
        if not run.has_inputs or joined.status(name) not in PASSED:
            continue
        unmade = "the answer to changed inputs, mass, and effects of wind and temperature"
        found[name] = (unprobed_remark(unmade, "a recording does not fly again"),)
        if joined.case.reference == "flight":
            found[name] += measure_scatter(joined.signals, name)
    for name, master in recorded.masters.items():
        if name in joined.runs:
            found[name] = (*found.get(name, ()), *recurrent_remarks(joined, name, master))
    return _with_remarks(joined, found)


def _join_results(first: PomResult, second: PomResult) -> PomResult:
    """Return the runs of two results of one case as one result."""
    if not first.runs:
        return second
    others = second.signals.isel(run=slice(1, None))
    signals = xr.concat([first.signals, others], "run", join="exact", combine_attrs="override")
    trim = first.trim.join(second.trim.drop(columns="flight"), how="outer")
    index = [
        *first.trim.index,
        *(name for name in second.trim.index if name not in first.trim.index),
    ]
    rows = [dict(row) for row in (*first.rows, *second.rows)]
    return replace(
        first,
        signals=signals.assign_attrs({**second.signals.attrs, **first.signals.attrs}),
        trim=trim.loc[index].rename_axis("quantity"),
        verdict=make_verdict_table(rows),  # type: ignore[arg-type]
        failure="; ".join(filter(None, (first.failure, second.failure))),
    )


def _with_remarks(result: PomResult, remarks: Mapping[str, tuple[RowRemark, ...]]) -> PomResult:
    """Return a result with further remarks on the rows of some runs."""
    if not any(remarks.values()):
        return result
    rows: list[dict[str, Any]] = []
    for row in result.rows:
        more = remarks.get(row["run"], ())
        rows.append({**row, "remarks": (*row["remarks"], *more)})  # type: ignore[dict-item]
    return replace(result, verdict=make_verdict_table(rows))


def recurrent_remarks(result: PomResult, run: str, master: MasterRun) -> tuple[RowRemark, ...]:
    """Return the remarks on a run compared with its master, the criterion stated.

    Every row of the case is judged with the master in the place of the flight, and with a share of
    its tolerance.
    """
    case, time = result.case, result.signals["time"].values
    criteria = [replace(c, fraction=c.fraction * master.share) for c in case.criteria]
    narrow = replace(case, criteria=tuple(criteria), fraction=case.fraction * master.share)
    other_flight = _compare_flights(result, master)
    outcomes = judge_all(
        narrow, time, traces_of(result.signals, master.name), traces_of(result.signals, run)
    )
    judged, skipped, unlike = {}, [], []
    for criterion in case.criteria:
        outcome = outcomes[criterion.name]
        if not criterion.applies:
            continue
        # A mode that the run has lost has no ratio, and is a larger change than any ratio.
        if outcome.fails_without_ratio:
            unlike.append(criterion.name)
        elif outcome.verdict in ("pass", "fail") and np.isfinite(outcome.worst_ratio):
            judged[criterion.name] = float(outcome.worst_ratio)
        else:
            skipped.append(criterion.name)
    stated = f"each row within {100.0 * master.share:g} % of its tolerance about {master.name}"
    texts = (*master.remarks, *other_flight)
    differences = [RowRemark("departure", f"departure: {text}") for text in texts]
    if not judged and not unlike:
        text = f"recurrent: not compared with {master.name}, no row has a value in both runs"
        return (RowRemark("recurrent_beyond", text), *differences)
    # a change of a single row counts, whether the flight has an alternative for it or not
    largest = max(judged.values(), default=0.0)
    is_beyond = largest > 1.0 or bool(unlike)
    word = "beyond" if is_beyond else "within"
    parts = [f"recurrent: {word} the criterion ({stated})"]
    values = {"share": master.share}
    if judged:
        name = max(judged, key=judged.__getitem__)
        parts[0] += f", largest {largest:.2f} of it in {name}"
        values["ratio"] = largest
    if unlike:
        parts.append(f"unlike the master without a ratio: {', '.join(unlike)}")
    if skipped:
        parts.append(f"not compared: {', '.join(skipped)}")
    kind = "recurrent_beyond" if is_beyond else "recurrent"
    return (RowRemark(kind, "; ".join(parts), values=values, unit="1"), *differences)


def shows_master(remarks: Iterable[RowRemark]) -> bool:
    """Return whether remarks are those of a master run."""
    for remark in remarks:
        # the name of a recording can hold any words
        is_recording = RECORDING in remark.text
        if remark.kind == "device" and OF_EARLIER in remark.text and not is_recording:
            return True
    return False


def _compare_flights(result: PomResult, master: MasterRun) -> Iterator[str]:
    """Yield the difference between the flight of a result and that of its master, if there is one.

    File names do not show another flight; each row judges one flight by the other.
    """
    if master.flight is None:
        return
    time, flight = result.signals["time"].values, traces_of(result.signals, "flight")
    outcomes = judge_all(result.case, time, flight, resample_run(master.flight, time))
    ratios: dict[str, float] = {}
    for name, outcome in outcomes.items():
        if outcome.fails_without_ratio:
            yield (
                f"the master is of another flight: {plain_words(name)} of one of the two flights "
                f"does not pass by the other, without a ratio"
            )
            return
        if np.isfinite(outcome.worst_ratio):
            ratios[name] = float(outcome.worst_ratio)
    if not ratios:
        yield "the flight of the master has no row in common with this one"
        return
    name = max(ratios, key=ratios.__getitem__)
    if ratios[name] > SAME_FLIGHT:
        yield (
            f"the master is of another flight: {plain_words(name)} of the two flights differs by "
            f"{ratios[name]:.2g} tolerances; compare with the master of this case"
        )
