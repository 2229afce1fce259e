"""One model through one job: canonical names and SI on this side, the variables and units of the
FMU on the other.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from platform import machine
from typing import Any

import numpy as np

from flightmech.errors import OutOfRange, SchemaError
from flightmech.support.kept_stages.content_hashes import content_hash
from pom.cases.case import PomCase
from pom.cases.job import ReplayJob, is_recorded
from pom.fmu.description import check_interface, demand_platform, read_fmu_interface
from pom.fmu.process import hire_worker
from pom.fmu.run_cache import FileState, KeptFlights
from pom.fmu.variable_map import Fmu, Links, links_of
from pom.fmu.worker.messages import moved_controls
from pom.tolerances.channels import WRAPPED

Found = dict[str, np.ndarray]


@dataclass(frozen=True)
class FmuModel:
    """An FMU and how its variables are reached; with the control law of the case, if it has one."""

    fmu: Fmu
    links: Links
    law: FmuModel | None = None

    def origin(self) -> str:
        """Return file, version and hash, as the attributes of a result keep it."""
        kind = ", model exchange" if self.fmu.exchange else ""
        return f"{self.fmu.path.name}, FMI {self.fmu.version}{kind}, sha256 {self.fmu.sha256}"


class Models:
    """The models of a batch, read once; each case may bring tables of names of its own.

    Parameters
    ----------
    runs : mapping of str to path
        Name of a model to its FMU.
    names : mapping of str to path, optional
        Name of a model to its table of names (`links_of`); it goes before that of a case.

    Raises
    ------
    ParseError, FileNotFoundError
        No FMU.
    SchemaError
        A model with the name of the recording, ``flight``; a table for a model that is not there.
    """

    def __init__(
        self, runs: Mapping[str, str | Path], names: Mapping[str, str | Path] | None = None
    ):
        self.names = {name: str(table) for name, table in (names or {}).items()}
        if "flight" in runs:
            raise SchemaError(
                "models", ["flight is the name of the recording; give the model another one"]
            )
        unknown = [name for name in self.names if name not in runs]
        if unknown:
            raise SchemaError(
                "names", [f"{name}: no such model; there are {', '.join(runs)}" for name in unknown]
            )
        self._fmus = {name: read_fmu_interface(file) for name, file in runs.items()}
        self._links: dict[tuple[str, str | None], Links] = {}
        self._laws: dict[tuple[str, str], FmuModel] = {}

    def demand_platform(self) -> None:
        """Raise if a model has no library for this platform.

        Raises
        ------
        SchemaError
            With every such model.
        """
        problems = []
        for name, fmu in self._fmus.items():
            try:
                demand_platform(fmu)
            except SchemaError as error:
                problems += [f"model {name}: {text}" for text in error.problems]
        if problems:
            raise SchemaError("models", problems)

    def of(self, case: PomCase) -> dict[str, FmuModel]:
        """Return the models as they speak in a case.

        Raises
        ------
        ParseError, FileNotFoundError
            No table of names.
        SchemaError
            A table that does not fit its FMU.
        """
        tables = {**case.models, **self.names}
        law = self.law_of(case) if case.law else None
        return {
            name: FmuModel(fmu, self._joined(name, tables.get(name)), law)
            for name, fmu in self._fmus.items()
        }

    def law_of(self, case: PomCase) -> FmuModel:
        """Return the control law of a case that has one; errors as `of`."""
        return self._law(case.law, case.law_names)

    def _law(self, file: str, names: str) -> FmuModel:
        if (file, names) not in self._laws:
            fmu = read_fmu_interface(file)
            self._laws[file, names] = FmuModel(fmu, links_of(fmu, names or None))
        return self._laws[file, names]

    def _joined(self, name: str, table: str | None) -> Links:
        if (name, table) not in self._links:
            self._links[name, table] = links_of(self._fmus[name], table)
        return self._links[name, table]


def fly_job(
    model: FmuModel,
    job: ReplayJob,
    wanted: Collection[str],
    timeout: float,
    store: KeptFlights | None = None,
) -> tuple[Found, str]:
    """Fly a job by a model in its child process.

    Parameters
    ----------
    model : Model
    job : Job
    wanted : collection of str
        Canonical names of outputs; those that the model has are returned.
    timeout : float
        Wall time allowed. [s]
    store : KeptFlights, optional
        Where flights are kept; one that is there is not flown again.

    Returns
    -------
    found : dict of str to array (time,)
        Outputs by canonical name, and the controls that the math pilot or the control law moved;
        NaN where the run did not come. [SI]
    failure : str
        Empty when all went well.
    """
    outputs = [
        name
        for name in model.links.outputs
        if name in {*wanted, *job.targets, *feedback_outputs(model)}
    ]
    time = _points(model.fmu, job.time)
    if model.law is not None:
        time = _common_points(model, model.law, time)
    task = _task(model, job, outputs, time)
    key = content_hash(_program(), model.fmu.sha256, task) if store else ""
    columns, failure = (
        store.read(key, (len(time), len(outputs) + len(moved_controls(task)))) if store else None,
        "",
    )
    if columns is None:
        fmus = [model.fmu, *([model.law.fmu] if model.law is not None else [])]
        before = [_as_read(fmu) for fmu in fmus]
        with hire_worker(model.fmu.path) as child:
            reply = child.run(task, timeout, any(fmu.once for fmu in fmus))
        columns, failure = np.column_stack([reply.outputs, *_moved(task, reply.moved)]), reply.error
        for fmu, state in zip(fmus, before, strict=True):
            if (
                state is None or _state(fmu) != state
            ):  # what flew may be neither the file that was read nor the one that is there
                columns, failure = (
                    np.full_like(columns, np.nan),
                    f"{fmu.path.name} changed after it was read; run the batch again",
                )
        if store and not failure:
            store.write(key, columns)
    return _found(model, job, outputs, time, task, columns), failure


def _as_read(fmu: Fmu) -> FileState | None:
    """Return the state of an FMU that is the file that was read, on another machine of a cluster by
    its hash; None of another one.
    """
    state = _state(fmu)
    if state is None or state == fmu.state:
        return state
    return state if hashlib.sha256(fmu.path.read_bytes()).hexdigest() == fmu.sha256 else None


def _state(fmu: Fmu) -> FileState | None:
    try:
        return FileState.of(fmu.path)
    except OSError:
        return None


def _points(fmu: Fmu, time: np.ndarray) -> np.ndarray:
    """Return the communication points: the samples, or even steps for an FMU that takes no others.
    [s]
    """
    if not fmu.even:
        return time
    step = fmu.step or float(np.median(np.diff(time)))
    return time[0] + step * np.arange(int(np.ceil((time[-1] - time[0]) / step - 1e-6)) + 1)


def feedback_outputs(model: FmuModel) -> list[str]:
    """Return the outputs of a model that its control law sees, by canonical name."""
    return (
        [] if model.law is None else [name for name in seen_by(model.law) if not is_recorded(name)]
    )


def seen_by(law: FmuModel) -> list[str]:
    """Return the inputs of a control law by canonical name, those apart that its table of names
    fixes.
    """
    return [name for name, link in law.links.inputs.items() if link.variable not in law.links.fixed]


def check_law(model: FmuModel, job: ReplayJob) -> None:
    """Check that a control law, its model and the record fit together.

    Raises
    ------
    SchemaError
        With every name that one of them lacks and every unit that does not fit.
    OutOfRange
        An input of the law has no value in the record.
    """
    law, given = model.law, job.law
    if law is None or given is None:
        return
    names = seen_by(law)
    check_interface(law.fmu, law.links, names, given.moves, ())
    problems = []
    for name in names:
        if is_recorded(name) and name not in given.recorded:
            problems.append(
                f"input {name}: the record has no such channel; map it, or hold it by [conditions]"
            )
        elif not is_recorded(name) and name not in model.links.outputs:
            problems.append(
                f"input {name}: the model {model.fmu.path.name} has no such output, and it "
                f"is no control that is recorded"
            )
        elif not is_recorded(name) and not np.isfinite(given.start.get(name, np.nan)):
            problems.append(
                f"input {name}: no value at the first sample, with which the law starts; map "
                f"the channel"
            )
    if problems:
        raise SchemaError(f"control law {law.fmu.path}", problems)
    for name in names:
        bad = ~np.isfinite(given.recorded[name]) if is_recorded(name) else np.zeros(1, bool)
        if bad.any():
            raise OutOfRange(
                f"control law: input {name} has no value in {int(bad.sum())} samples; repair "
                f"the record or move the window",
                bad,
            )


def _common_points(model: FmuModel, law: FmuModel, time: np.ndarray) -> np.ndarray:
    """Return the communication points of a model and its control law. [s]"""
    points = _points(law.fmu, time)
    if model.fmu.even and not (len(points) == len(time) and np.allclose(points, time, atol=1e-9)):
        raise SchemaError(
            f"control law {law.fmu.path}",
            [
                f"it takes steps of {law.fmu.step:g} s only, the model {model.fmu.path.name} "
                f"others; export one of them with variable steps"
            ],
        )
    return points


def _law_task(
    model: FmuModel, job: ReplayJob, outputs: list[str], inputs: list[str], at_points: Callable
) -> dict[str, Any]:
    """Return the control law as the worker takes it, everything in the units of the FMUs."""
    law, given = model.law, job.law
    assert law is not None
    assert given is not None
    names, links = seen_by(law), law.links
    fixed = {name: value for name, value in links.fixed.items() if name in law.fmu.inputs}
    count = len(at_points(job.time))
    columns = [
        links.inputs[name].to_fmu(at_points(given.recorded[name]))
        if is_recorded(name)
        else np.zeros(count)
        for name in names
    ]
    columns += [np.full(count, value) for value in fixed.values()]
    start = [
        links.inputs[name].to_fmu(
            given.recorded[name][0] if is_recorded(name) else given.start[name]
        )
        for name in names
    ]
    rows = []
    for i, name in enumerate(names):
        if not is_recorded(name):
            out, into = model.links.outputs[name], links.inputs[name]
            rows.append(
                (
                    i,
                    outputs.index(name),
                    out.factor / into.factor,
                    (out.offset - into.offset) / into.factor,
                )
            )
    moves = {}
    for name in given.moves:
        out, into = links.outputs[name], model.links.inputs[name]
        place = inputs.index(into.variable)
        moves[name] = (
            place,
            out.factor / into.factor,
            (out.offset - into.offset) / into.factor,
            out.factor,
            out.offset,
        )
    return {
        "fmu": str(law.fmu.path),
        "sha256": law.fmu.sha256,
        "inputs": [*(links.inputs[name].variable for name in names), *fixed],
        "values": np.column_stack(columns) if columns else np.zeros((count, 0)),
        "start": [*map(float, start), *fixed.values()],
        "parameters": {
            name: value for name, value in links.fixed.items() if name not in law.fmu.inputs
        },
        "feedback": rows,
        "outputs": [links.outputs[name].variable for name in given.moves],
        "moves": moves,
    }


def _task(model: FmuModel, job: ReplayJob, outputs: list[str], time: np.ndarray) -> dict[str, Any]:
    """Return the job as the worker takes it: names, units and signs of the FMU, at its
    communication points.
    """
    links = model.links

    def at_points(values: np.ndarray) -> np.ndarray:
        return values if time is job.time else np.interp(time, job.time, values)

    inputs = {
        links.inputs[name].variable: links.inputs[name].to_fmu(at_points(u))
        for name, u in job.inputs.items()
        if name in links.inputs
    }
    parameters = {
        links.parameters[name].variable: links.parameters[name].to_fmu(value)
        for name, value in job.parameters.items()
        if name in links.parameters
    }
    inputs |= {
        name: np.full(len(time), value)
        for name, value in links.fixed.items()
        if name in model.fmu.inputs
    }
    parameters |= {
        name: value for name, value in links.fixed.items() if name not in model.fmu.inputs
    }
    task = {
        "time": time,
        "inputs": inputs,
        "parameters": parameters,
        "outputs": [links.outputs[name].variable for name in outputs],
    }
    if model.law is not None and job.law is not None:
        task["law"] = _law_task(model, job, outputs, list(inputs), at_points)
    if job.pilot:
        targets = {name: at_points(values) for name, values in job.targets.items()}
        task["pilot"] = {"targets": targets, **_hand(links, job, outputs, list(inputs))}
    return task


def _hand(links: Links, job: ReplayJob, outputs: list[str], inputs: list[str]) -> dict[str, Any]:
    """Return the loops of the math pilot, what they see (column, factor, offset to SI) and what
    they move (column, factor to SI).
    """
    seen = {name: links.outputs[name] for name in job.targets}
    moved = {loop.control: links.inputs[loop.control] for loop in job.pilot}
    return {
        "loops": [asdict(loop) for loop in job.pilot],
        "sense": {
            name: (outputs.index(name), link.factor, link.offset) for name, link in seen.items()
        },
        "move": {name: (inputs.index(link.variable), link.factor) for name, link in moved.items()},
    }


def _moved(task: Mapping[str, Any], moved: Mapping[str, np.ndarray]) -> list[np.ndarray]:
    nothing = np.full(len(task["time"]), np.nan)
    return [moved.get(name, nothing) for name in moved_controls(task)]


def _found(
    model: FmuModel,
    job: ReplayJob,
    outputs: list[str],
    time: np.ndarray,
    task: Mapping[str, Any],
    columns: np.ndarray,
) -> Found:
    """Return what was flown at the samples of the job, by canonical name and in SI."""
    found = {
        name: model.links.outputs[name].to_canonical(columns[:, i])
        for i, name in enumerate(outputs)
    }
    if len(time) != len(job.time) or not np.array_equal(time, job.time):
        found = {name: _at_samples(name, values, time, job.time) for name, values in found.items()}
    for i, name in enumerate(moved_controls(task)):
        place = np.clip(np.searchsorted(time, job.time + 1e-9, side="right") - 1, 0, len(time) - 1)
        found[name] = job.inputs[name] + columns[place, len(outputs) + i]
    return found


def _at_samples(name: str, values: np.ndarray, time: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Return an output between the steps of its FMU, on straight lines; angles that jump are made
    continuous first.
    """
    if name in WRAPPED:
        known = np.isfinite(values)
        values = np.where(known, np.unwrap(np.where(known, values, 0.0)), np.nan)
    return np.interp(samples, time, values)


@cache
def _program() -> str:
    """Return what flies a job: the hash of its modules, the version of FMPy, the kind of machine."""
    here = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for file in [here / "cases" / "pilot.py", *sorted((here / "fmu" / "worker").glob("*.py"))]:
        digest.update(file.read_bytes())
    return f"{digest.hexdigest()} {version('fmpy')} {sys.platform} {machine()}"
