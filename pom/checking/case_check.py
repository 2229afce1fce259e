"""Checks of the flight records behind a report: a pass against a faulty record does not count as a
pass.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr
from joblib import Parallel, delayed

import flighttest
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError, OutOfRange, SchemaError, SimulationError, UnknownName
from flightmech.simulation.compiler import SimModel
from pom.cases.case import PomCase
from pom.fmu.models import FmuModel
from pom.fmu.variable_map import Fmu, links_of
from pom.replaying.kernel_replay import start_untrimmed
from pom.replaying.replay_case import ReplayPlan, check_plan, plan_of
from pom.result import PomResult, make_verdict_table
from pom.tolerances.bands import RowRemark

MOST_CHANNELS = 40
"""Missing channels of one case that are listed; a case needs fewer."""


def case_problems(case: PomCase, states: xr.Dataset, models: Mapping[str, FmuModel]) -> list[str]:
    """Return why a case cannot be flown.

    Parameters
    ----------
    case : PomCase
    states : Dataset (time,)
        States of the whole record: those of a reconstructed path, or
        `flighttest.reconstruction.start_states`. [SI]
    models : mapping of str to Model
        By name; empty to check the record alone.

    Returns
    -------
    list of str
        A line for every problem: the window, every channel that the record lacks, samples without a
        value, and every input, output and parameter that a model lacks. Empty if the case can be
        flown.
    """
    return _planned(case, states, models)[0]


def _planned(
    case: PomCase, states: xr.Dataset, models: Mapping[str, FmuModel]
) -> tuple[list[str], ReplayPlan | None]:
    """Return why a case cannot be flown, and its plan if there is one."""
    problems: list[str] = []
    for _ in range(MOST_CHANNELS):
        try:
            plan = plan_of(case, states)
            break
        except UnknownName as error:
            # The channel is added without motion, so that the next one that is missing is found as
            # well.
            problems.append(_named(case, str(error)))
            if error.name in states:
                return problems, None
            states = states.assign({error.name: ("time", np.zeros(states.sizes["time"]))})
        except (SchemaError, OutOfRange) as error:
            return [*problems, *(_named(case, text) for text in _texts(error))], None
    else:
        return problems, None
    for name, model in models.items():
        try:
            check_plan(plan, model)
        except (SchemaError, OutOfRange) as error:
            problems += [f"case {case.name}, model {name}: {text}" for text in _texts(error)]
    return problems, plan


def kernel_model(name: str, sim: SimModel) -> FmuModel:
    """Return a compiled model as `check_plan` takes it: as the FMU that `flightmech.write_fmu`
    makes of it, without writing one.

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
    """Return why a case cannot be flown, as `case_problems`, and else why the kernel refuses to
    start it, apart from its trim.

    Parameters
    ----------
    case : PomCase
    states : Dataset (time,)
    models : mapping of str to Model
        As for `case_problems`.
    sims : mapping of str to SimModel
        Compiled models by name; none for a case with a control law, which the kernel does not fly.

    Returns
    -------
    list of str
        A drive that no engine of the aircraft has, and the like.
    """
    problems, plan = _planned(case, states, models)
    if problems or plan is None:
        return problems
    for name, sim in sims.items():
        try:
            start_untrimmed(sim, plan.job)
        except SimulationError as error:
            problems.append(f"case {case.name}, model {name}: {error}")
    return problems


def _named(case: PomCase, text: str) -> str:
    """Return a problem behind the name of its case."""
    return text if text.startswith(f"case {case.name}") else f"case {case.name}: {text}"


def _texts(error: AeromatchError) -> list[str]:
    return list(error.problems) if isinstance(error, SchemaError) else [str(error)]


@dataclass(frozen=True)
class RecordError:
    """An error that a check found in a flight record.

    Attributes
    ----------
    name : str
        Kind and channels, ``sign:delta_e``.
    text : str
        What was found, and the remedy.
    start, stop : float or None
        Part of the record; None for the whole record. [s]
    """

    name: str
    text: str
    start: float | None = None
    stop: float | None = None

    def concerns(self, window: tuple[float, float]) -> bool:
        """Return whether the error lies inside a window of the record, or concerns all of it."""
        if self.start is None or self.stop is None:
            return True
        return self.start <= window[1] and window[0] <= self.stop


@dataclass(frozen=True)
class RecordCheck:
    """The check of one flight record (`flighttest.assess`).

    Attributes
    ----------
    record : str
        Name of the record.
    verdict : str
        The result in one line.
    errors : tuple of RecordError
    """

    record: str
    verdict: str
    errors: tuple[RecordError, ...] = ()

    @classmethod
    def of(cls, name: str, record: xr.DataTree, aircraft: Aircraft | None) -> RecordCheck:
        """Return the check of a record; of one that cannot be checked the reason as its verdict."""
        try:
            quality = flighttest.assess(record, aircraft)
        except AeromatchError as error:
            return cls(name, f"not checked: {error}")
        found = [
            RecordError(item.name, _in_one_line(item.text, item.remedy), item.start, item.stop)
            for item in quality.findings
            if item.severity == "error"
        ]
        return cls(name, quality.verdict, tuple(found))

    def lines(self) -> list[str]:
        """Return the errors, a line each."""
        return [
            f"record {self.record}: {error.name}{_place(error)}: {error.text}"
            for error in self.errors
        ]


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

    calls = (delayed(RecordCheck.of)(name, record, aircraft) for name, record in records.items())
    return dict(zip(records, Parallel(n_jobs=jobs if len(records) > 1 else 1)(calls), strict=True))


def with_record_checks(
    results: Iterable[PomResult], checks: Mapping[str, RecordCheck]
) -> list[PomResult]:
    """Return results whose rows carry the errors of their record.

    Parameters
    ----------
    results : iterable of PomResult
    checks : mapping of str to RecordCheck
        By the path of a record, or by its file name without extension.

    Returns
    -------
    list of PomResult
        A result without an error in its window as it is. In another one every row has a remark of
        kind ``record``, so that a pass becomes ``record_error`` (`PomResult.status`).
    """
    return [_remarked(result, checks) for result in results]


def _remarked(result: PomResult, checks: Mapping[str, RecordCheck]) -> PomResult:
    case = result.case
    check = checks.get(case.record) or checks.get(Path(case.record).stem)
    errors = [error for error in check.errors if error.concerns(case.window)] if check else []
    if not errors:
        return result
    more = tuple(
        RowRemark("record", f"error of the flight record: {error.name}: {error.text}", error.name)
        for error in errors
    )
    rows = [{**row, "remarks": (*row["remarks"], *more)} for row in result.rows]
    return replace(result, verdict=make_verdict_table(rows))  # type: ignore[arg-type]


def checks_text(checks: Iterable[RecordCheck]) -> dict[str, str]:
    """Return the errors of records that have any, by the name of the record, for the provenance of
    a report.
    """
    return {
        check.record: "; ".join(
            f"{error.name}{_place(error)}: {error.text}" for error in check.errors
        )
        for check in checks
        if check.errors
    }


def _place(error: RecordError) -> str:
    return (
        ""
        if error.start is None or error.stop is None
        else f" [{error.start:g} ... {error.stop:g} s]"
    )


def _in_one_line(text: str, remedy: str) -> str:
    joined = f"{text}; {remedy}" if remedy else text
    return " ".join(joined.split())
