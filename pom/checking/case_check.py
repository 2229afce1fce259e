"""Checks of cases and their flight records; a pass against a faulty record is not a pass."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from joblib import delayed

import flighttest
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError, OutOfRange, SchemaError, SimulationError, UnknownName
from flightmech.quantities import time_text
from flightmech.simulation.compiler import SimModel
from flightmech.support.kept_stages.sharing import process_pool
from flighttest.reconstruction.quality import describe_name
from flighttest.reconstruction.quality.record_notes import MISSING_CODE
from pom.cases.case import PomCase, driven_quantities
from pom.fmu.models import FmuModel
from pom.fmu.variable_map import Fmu, links_of
from pom.replaying.kernel_replay import start_untrimmed
from pom.replaying.replay_case import ReplayPlan, check_plan, plan_of
from pom.result import PomResult, make_verdict_table
from pom.tolerances.bands import RowRemark

AIRSPEED = "scale:V"
"""Start of the name of the finding on a scale of the airspeed, or of the temperature in it."""
SMALL = "small_scale"
"""Kind of that finding where it is a note on the record: a position error can be as large."""
NO_FLIGHT = ("held", "missing", "outside", "gap", "lost")
"""Kinds of faults of samples after which no reading of the flight is left."""
MOST_CHANNELS = 40
"""Largest number of missing channels that the check of a case lists; a case needs fewer."""


def case_problems(case: PomCase, states: xr.Dataset, models: Mapping[str, FmuModel]) -> list[str]:
    """Return the problems that prevent the replay of a case.

    Parameters
    ----------
    case : PomCase
    states : Dataset (time,)
        States of the whole record: of a reconstructed path, or
        `flighttest.reconstruction.start_states`. [SI]
    models : mapping of str to FmuModel
        Models by name; empty to check the record alone.

    Returns
    -------
    list of str
        One line for every problem: the window, missing channels of the record, samples without a
        value, and missing inputs, outputs and parameters of a model.  Empty if the case can be
        replayed.
    """
    problems, _ = _plan_case(case, states, models)
    return problems


def _plan_case(
    case: PomCase, states: xr.Dataset, models: Mapping[str, FmuModel]
) -> tuple[list[str], ReplayPlan | None]:
    """Return the problems of a case, and its plan if the record is sufficient."""
    problems, plan = _plan_record(case, states)
    if plan is None:
        return problems, None
    for name, model in models.items():
        try:
            check_plan(plan, model)
        except (SchemaError, OutOfRange) as error:
            problems += [f"case {case.name}, model {name}: {text}" for text in _error_texts(error)]
    return problems, plan


def _plan_record(case: PomCase, states: xr.Dataset) -> tuple[list[str], ReplayPlan | None]:
    """Return the problems of a case with its record, and the plan if there is one."""
    problems: list[str] = []
    for _ in range(MOST_CHANNELS):
        try:
            return problems, plan_of(case, states)
        except UnknownName as error:
            problems.append(_name_case(case, str(error)))
            # a channel that the states have is unknown for another reason
            if error.name in states:
                return problems, None
            # Zeros stand for the missing channel, so that the next attempt finds the next one.
            states = states.assign({error.name: ("time", np.zeros(states.sizes["time"]))})
        except (SchemaError, OutOfRange) as error:
            problems += [_name_case(case, text) for text in _error_texts(error)]
            return problems, None
    return problems, None


def kernel_model(name: str, sim: SimModel) -> FmuModel:
    """Return the interface of a compiled model for `check_plan`.

    It is the interface of the FMU that `flightmech.write_fmu` would write.

    Parameters
    ----------
    name : str
        Name of the model.
    sim : SimModel
    """
    interface = Fmu(
        Path(f"{name}.fmu"),
        "3.0",
        "",
        inputs=dict.fromkeys(sim.inputs, ""),
        outputs=dict.fromkeys(sim.outputs, ""),
        parameters=dict.fromkeys(sim.parameters, ""),
    )
    return FmuModel(interface, links_of(interface))


def start_problems(
    case: PomCase, states: xr.Dataset, models: Mapping[str, FmuModel], sims: Mapping[str, SimModel]
) -> list[str]:
    """Return the problems of `case_problems`, or else those of the kernel at the start.

    The trim is not checked.

    Parameters
    ----------
    case : PomCase
    states : Dataset (time,)
        As for `case_problems`. [SI]
    models : mapping of str to FmuModel
        As for `case_problems`.
    sims : mapping of str to SimModel
        Compiled models by name; empty for a case with a control law, which the kernel does not
        replay.

    Returns
    -------
    list of str
        For example a drive that the engines of the aircraft do not have.
    """
    problems, plan = _plan_case(case, states, models)
    if problems or plan is None:
        return problems
    for name, sim in sims.items():
        try:
            start_untrimmed(sim, plan.job)
        except SimulationError as error:
            problems.append(f"case {case.name}, model {name}: {error}")
    return problems


def _name_case(case: PomCase, text: str) -> str:
    """Return a problem with the name of its case in front."""
    if text.startswith(f"case {case.name}"):
        return text
    return f"case {case.name}: {text}"


def _error_texts(error: AeromatchError) -> list[str]:
    """Return the problems of an error, a line each."""
    if isinstance(error, SchemaError):
        return list(error.problems)
    return [str(error)]


@dataclass(frozen=True)
class RecordError:
    """Error of a flight record.

    Attributes
    ----------
    name : str
        Kind and channels, ``sign:delta_e``.
    text : str
        Finding and remedy.
    start, stop : float or None
        Part of the record; None for the whole record. [s]
    """

    name: str
    text: str
    start: float | None = None
    stop: float | None = None

    def concerns(self, window: tuple[float, float]) -> bool:
        """Return whether the error overlaps a window of the record."""
        if self.start is None or self.stop is None:
            # an error of the whole record
            return True
        return self.start <= window[1] and window[0] <= self.stop

    @property
    def title(self) -> str:
        """Kind and channels in words: "sign of delta_e (elevator deflection)"."""
        return describe_name(self.name)

    def line(self) -> str:
        """Return title, part of the record and text in one line."""
        if self.start is None or self.stop is None:
            return f"{self.title}: {self.text}"
        return f"{self.title} [{time_text(self.start)} ... {time_text(self.stop)} s]: {self.text}"


class SampleFault(NamedTuple):
    """Samples of a channel, or of a group of channels at a gap, that show no flight. [s]"""

    channels: tuple[str, ...]
    kind: str
    start: float
    stop: float


@dataclass(frozen=True)
class RecordCheck:
    """Check of one flight record (`flighttest.assess`).

    Attributes
    ----------
    record : str
        Name of the record.
    verdict : str
        The result in one line.
    errors, warnings : tuple of RecordError
    faults : tuple of SampleFault
        Held, missing and lost values, and gaps of the clock.
    """

    record: str
    verdict: str
    errors: tuple[RecordError, ...] = ()
    warnings: tuple[RecordError, ...] = ()
    faults: tuple[SampleFault, ...] = ()

    @classmethod
    def of(cls, name: str, record: xr.DataTree, aircraft: Aircraft | None) -> RecordCheck:
        """Return the check of a record.

        If the record cannot be checked, the verdict is the reason.
        """
        try:
            quality = flighttest.assess(record, aircraft)
        except AeromatchError as error:
            return cls(name, f"not checked: {error}")
        by_severity: dict[str, list[RecordError]] = {"error": [], "warning": []}
        for item in quality.findings:
            severity = item.severity
            if severity == "note" and item.name.startswith(AIRSPEED):
                # small for a record, but rows judge the model with it
                severity = "warning"
                item = replace(item, kind=SMALL)
            if severity == "note" and item.kind == MISSING_CODE:
                # a value that the reader leaves out must be seen by the reader of the report
                severity = "warning"
            if severity in by_severity:
                text = _join_lines(item.text, item.remedy)
                finding = RecordError(item.name, text, start=item.start, stop=item.stop)
                by_severity[severity].append(finding)
        faults = tuple(_sample_faults(quality.faults, record))
        return cls(
            name,
            quality.verdict,
            errors=tuple(by_severity["error"]),
            warnings=tuple(by_severity["warning"]),
            faults=faults,
        )

    def lines(self) -> list[str]:
        """Return the errors, a line each."""
        return [f"record {self.record}: {error.line()}" for error in self.errors]


def _sample_faults(table: pd.DataFrame, record: xr.DataTree) -> Iterator[SampleFault]:
    """Yield the faults of `flighttest.assess` after which samples show no flight."""
    for row in table.to_dict("records"):
        if row["kind"] not in NO_FLIGHT:
            continue
        channels: tuple[str, ...] = (str(row["channel"]),)
        if not row["channel"]:
            # a gap of the clock concerns all channels of its group
            channels = tuple(map(str, record[row["leaf"]].data_vars))
        yield SampleFault(channels, str(row["kind"]), float(row["start"]), float(row["stop"]))


def check_records(
    records: Mapping[str, xr.DataTree], aircraft: Aircraft | None, jobs: int = 1
) -> dict[str, RecordCheck]:
    """Return the check of every record by name; the same for any number of processes.

    Parameters
    ----------
    records : mapping of str to DataTree
        As `flighttest.read` returns them.
    aircraft : Aircraft or None
        With its instruments.
    jobs : int
        Processes; -1 for one per core.
    """
    # one record does not need a second process
    if len(records) <= 1:
        jobs = 1
    calls = (delayed(RecordCheck.of)(name, record, aircraft) for name, record in records.items())
    return dict(zip(records, process_pool(jobs)(calls), strict=True))


def check_key(case: PomCase) -> str:
    """Return the name of the check of a record: record, name map and aircraft of the case."""
    return " | ".join([case.record, case.names, case.aircraft])


def with_record_checks(
    results: Iterable[PomResult], checks: Mapping[str, RecordCheck]
) -> list[PomResult]:
    """Return results whose rows state the errors of their record.

    Parameters
    ----------
    results : iterable of PomResult
    checks : mapping of str to RecordCheck
        By `check_key`, by the path of a record, or by its file name without extension.

    Returns
    -------
    list of PomResult
        A result without a finding in its window does not change.  In another result every row has a
        remark of kind ``record`` for each error, so that a pass becomes ``record_error``
        (`PomResult.status`), ``departure`` for a control of wrong time or size that drives the
        model, and ``record_warning`` for each other warning.
    """
    return [_add_record_remarks(result, checks) for result in results]


def _add_record_remarks(result: PomResult, checks: Mapping[str, RecordCheck]) -> PomResult:
    case = result.case
    keys = (check_key(case), case.record, Path(case.record).stem)
    check = next((checks[key] for key in keys if key in checks), None)
    if check is None:
        return result
    remarks = []
    for error in check.errors:
        if error.concerns(case.window):
            text = f"error of the flight record: {error.title}: {error.text}"
            remarks.append(RowRemark("record", text, error.name))
    driven = driven_quantities(case)
    for warning in check.warnings:
        if not warning.concerns(case.window):
            continue
        text = f"warning on the flight record: {warning.title}: {warning.text}"
        kind, _, channels = warning.name.partition(":")
        # a control that is late, or of another size, drives the model
        is_driving = kind in ("lag", "scale") and driven.intersection(channels.split("+"))
        # dynamic pressure and damping of the model go with the airspeed
        if is_driving or warning.name.startswith(AIRSPEED):
            remarks.append(RowRemark("departure", f"departure: {text}", warning.name))
        else:
            remarks.append(RowRemark("record_warning", text, warning.name))
    if not remarks:
        return result
    rows = [{**row, "remarks": (*row["remarks"], *remarks)} for row in result.rows]
    return replace(result, verdict=make_verdict_table(rows))  # type: ignore[arg-type]


def checks_text(checks: Iterable[RecordCheck]) -> dict[str, str]:
    """Return the errors of faulty records by the name of the record, for a provenance."""
    texts = {}
    for check in checks:
        if check.errors:
            texts[check.record] = "; ".join(error.line() for error in check.errors)
    return texts


def codes_text(checks: Iterable[RecordCheck]) -> str:
    """Return the numbers that were read as missing values, by record, for a provenance."""
    texts = []
    for check in checks:
        codes = [item.text for item in check.warnings if item.name.startswith(MISSING_CODE)]
        if codes:
            texts.append(f"{check.record}: {'; '.join(codes)}")
    return "; ".join(texts)


def _join_lines(text: str, remedy: str) -> str:
    """Return a finding and its remedy in one line."""
    joined = f"{text}; {remedy}" if remedy else text
    return " ".join(joined.split())
