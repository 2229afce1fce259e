"""Check of all cases and raw records before a batch, ahead of slow reconstructions."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from joblib import delayed

import flighttest
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import AeromatchError, SchemaError
from flightmech.support.atomic_write import write_text
from flightmech.support.kept_stages.sharing import process_pool
from flighttest.reconstruction.states_at_start import start_states
from pom.cases.case import PomCase
from pom.cases.fact_agreement import demand_agreement
from pom.cases.reference_states import read_path_states
from pom.checking.case_check import RecordCheck, RecordError, case_problems, check_key
from pom.fmu.models import FmuModel, Models
from pom.replaying.caches import KeptStates


@dataclass(frozen=True)
class KeptChecks:
    """Stored checks by record, name map, aircraft and program version; one file each.

    Attributes
    ----------
    folder : Path or None
        Folder of the files, created if it is missing; None for no storage.
    """

    folder: Path | None

    def read(self, case: PomCase) -> RecordCheck | None:
        """Return the stored check of the record of a case; None if missing or damaged."""
        file = self._file(case)
        if file is None or not file.is_file():
            return None
        try:
            item: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
            errors = tuple(RecordError(**error) for error in item["errors"])
            warnings = tuple(RecordError(**warning) for warning in item["warnings"])
            return RecordCheck(item["record"], item["verdict"], errors, warnings)
        except (ValueError, KeyError, TypeError):
            # a damaged file is computed and written again
            return None

    def write(self, case: PomCase, check: RecordCheck) -> None:
        """Write the check of the record of a case."""
        file = self._file(case)
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            write_text(file, json.dumps(asdict(check), ensure_ascii=False))

    def _file(self, case: PomCase) -> Path | None:
        if self.folder is None:
            return None
        return self.folder / "checks" / f"{KeptStates(self.folder, None).identity(case)}.json"


PATH = "reconstructed path"
"""Verdict on a reconstructed path, which has no instruments to check."""


def check_batch(
    cases: Sequence[PomCase],
    models: Models | None = None,
    jobs: int = 1,
    folder: str | Path | None = None,
) -> dict[str, RecordCheck]:
    """Check every case and its record before a batch.

    Parameters
    ----------
    cases : sequence of PomCase
    models : Models, optional
        Models of the batch; without them the records alone are checked.
    jobs : int
        Processes; -1 for one per core.
    folder : path, optional
        Folder of stored checks.  Cases of a stored check are not checked again.

    Returns
    -------
    dict of str to RecordCheck
        By the path of the record, in the order of the cases.  A record that its cases read with
        several name maps or aircraft has a check for each, by `check_key`.

    Raises
    ------
    SchemaError
        With every problem of every case of a raw record (`case_problems`), or every contradiction
        between cases on facts of the aircraft.  `pom.replay_all` checks
        the cases of reconstructed paths itself.
    """
    demand_agreement(cases)
    groups = _group_cases(cases)
    store = KeptChecks(Path(folder).resolve() if folder is not None else None)
    checks: dict[str, RecordCheck] = {}
    unchecked: dict[str, list[PomCase]] = {}
    for key, group in groups.items():
        check = store.read(group[0])
        if check is None:
            unchecked[key] = group
        else:
            checks[key] = replace(check, record=_check_name(key, group[0]))
    calls = []
    for key, group in unchecked.items():
        name = _check_name(key, group[0])
        calls.append(delayed(check_record_and_cases)(group, _models_of(group, models), name))
    # One record does not need a second process.
    if len(unchecked) <= 1:
        jobs = 1
    results = dict(zip(unchecked, process_pool(jobs)(calls), strict=True))
    problems: list[str] = []
    for _, texts in results.values():
        problems += texts
    if problems:
        raise SchemaError("cases", list(dict.fromkeys(problems)))
    for key, (check, _) in results.items():
        checks[key] = check
        store.write(unchecked[key][0], check)
    return {key: checks[key] for key in groups}


def _group_cases(cases: Sequence[PomCase]) -> dict[str, list[PomCase]]:
    """Return the cases that share a check, so that each record is read once.

    Name map and aircraft decide what a record means, so cases share them too.
    """
    by_record: dict[str, dict[str, list[PomCase]]] = {}
    for case in cases:
        by_record.setdefault(case.record, {}).setdefault(check_key(case), []).append(case)
    groups: dict[str, list[PomCase]] = {}
    for record, by_key in by_record.items():
        if len(by_key) == 1:
            groups[record] = next(iter(by_key.values()))
        else:
            groups |= by_key
    return groups


def _check_name(key: str, case: PomCase) -> str:
    """Return the name of a check in messages: the record, and the files that differ."""
    name = Path(case.record).stem
    if key == case.record:
        return name
    files = [Path(file).name for file in (case.names, case.aircraft) if file]
    return f"{name} ({', '.join(files) or 'no name map, no aircraft'})"


def _models_of(cases: Sequence[PomCase], models: Models | None) -> list[Mapping[str, FmuModel]]:
    """Return the models of every case; none without models."""
    if models is None:
        return [{} for _ in cases]
    return [models.of(case) for case in cases]


def check_record_and_cases(
    cases: Sequence[PomCase], models: Sequence[Mapping[str, FmuModel]], name: str = ""
) -> tuple[RecordCheck, list[str]]:
    """Return the check of a record, and the problems of its cases with their models.

    Parameters
    ----------
    cases : sequence of PomCase
        Cases of one record, with one name map and aircraft.
    models : sequence of mapping of str to FmuModel
        Models of each case, by name.
    name : str
        Name of the check in messages; by default the file name of the record without extension.
    """
    first = cases[0]
    name = name or Path(first.record).stem
    if read_path_states(first.record) is not None:
        return RecordCheck(name, PATH), []
    if not first.aircraft:
        missing = (
            "case.aircraft: missing; the record has to be reconstructed, and that needs "
            "the aircraft"
        )
        problems = [f"case {case.path}: {missing}" for case in cases if not case.aircraft]
        # an empty verdict: the record was not checked
        return RecordCheck(name, ""), problems
    try:
        record = flighttest.read(first.record, names=first.names or None)
        aircraft = read_aircraft(first.aircraft)
        states = start_states(record, aircraft)
    except SchemaError as error:
        return RecordCheck(name, ""), [f"record {name}: {text}" for text in error.problems]
    except AeromatchError as error:
        return RecordCheck(name, ""), [f"record {name}: {error}"]
    problems = []
    for case, case_models in zip(cases, models, strict=True):
        problems += case_problems(case, states, case_models)
    return RecordCheck.of(name, record, aircraft), problems
