"""Products of a match as stages: files of the models, replays, samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import aerodb
import flightmech
import pom
from flightmech.support.kept_stages.content_hashes import FileContent
from flightmech.support.kept_stages.stages import Kept, Stages, Values
from flightmech.support.kept_stages.store import StageStore
from pom.diagnosis.sampling.sampled_replay import samples_of_case
from pom.result import PomResult


@dataclass(frozen=True)
class MatchOutcome:
    """What `aeromatch.workflow.perform_match` made.

    Attributes
    ----------
    results : list of PomResult
        One per case.
    corrected_terms : list of str
        Terms, and parts of the aircraft, that the corrected model takes from the final one.
    corrected_submodels : dict of str to list of str
        The same by submodel: ``aerodynamics``, ``ground effect``, ``control loading``, ``engine``,
        ``landing gear``.
    joint_terms : dict of str to list of str
        Those of them that no case needs alone: added since the terms of one case change another, by
        the case for which.
    differing : int
        Terms and parts that differ between the a-priori and the final model.
    tables : Kept
        Final database without its submodels, and the tabulation behind it.
    report : Path
        Of ``report.html``.
    files : list of str
        All that was written, from the output folder.
    record_errors : list of str
        Errors that the checks of the flight records found, a line each.
    """

    results: list[Any]
    corrected_terms: list[str]
    corrected_submodels: dict[str, list[str]]
    joint_terms: dict[str, list[str]]
    differing: int
    tables: Kept[tuple[Any, Any]]
    report: Path
    files: list[str]
    record_errors: list[str] = field(default_factory=list)

    @property
    def tabulation(self) -> Any:
        """How the terms came about, a `Tabulation`."""
        return self.tables.value[1]

    def to_dict(self) -> dict[str, Any]:
        """Return the verdicts as plain data."""
        return {
            "report": str(self.report),
            "corrected_terms": self.corrected_terms,
            "corrected_submodels": self.corrected_submodels,
            "joint_terms": self.joint_terms,
            "record_errors": self.record_errors,
            "differing": self.differing,
            "warnings": list(self.tabulation.notices),
            "cases": [
                {
                    "name": result.case.name,
                    "id": result.case.id,
                    "status": {run: result.status(run) for run in result.runs},
                    "verdict": result.verdict_records(),
                    "failure": result.failure,
                    "samples": {run: found.numbers() for run, found in result.samples.items()},
                }
                for result in self.results
            ],
        }


def model_files(
    stages: Stages, name: str, database: Kept[Any], aircraft: Kept[Any]
) -> Kept[dict[str, bytes]]:
    """Return database, aircraft and FMU of a model as files by name."""

    def make() -> dict[str, bytes]:
        with TemporaryDirectory() as place:
            folder = Path(place)
            aerodb.save(database.value, folder / f"{name}.nc")
            flightmech.write_aircraft(aircraft.value, folder / f"{name}.toml")
            flightmech.write_fmu(
                flightmech.compile(aircraft.value, database.value), folder / f"{name}.fmu"
            )
            return {file.name: file.read_bytes() for file in sorted(folder.iterdir())}

    return stages.one(
        "model files", {"name": name, "database": database, "aircraft": aircraft}, make, name
    )


def write_files(files: Mapping[str, bytes], folder: Path) -> None:
    """Write files into a folder."""
    for name, content in files.items():
        (folder / name).write_bytes(content)


def of_cases(
    cases: Sequence[Any],
    paths: Mapping[str, Kept[Any]],
    fmus: Mapping[str, Path],
    tables: Mapping[str, Path],
    evidence: Kept[Any],
    content: Callable[[Path], FileContent],
) -> dict[str, dict[str, Any]]:
    """Return all that the replay of every case depends on, by name of the case.

    Parameters
    ----------
    cases : sequence of PomCase
    paths : mapping of str to Kept
        Reconstructed paths by record.
    fmus, tables : mapping of str to path
        Models, and tables of names of those that have one.
    evidence : Kept of DataTree
    content : callable
        Gives the content of a file.
    """
    common = {
        "models": [(name, content(file)) for name, file in fmus.items()],
        "names of models": [(name, content(file)) for name, file in tables.items()],
        "evidence": evidence,
    }
    found = {}
    for case in cases:
        files = [
            content(Path(name))
            for name in (case.names, case.aircraft, case.law, case.law_names)
            if name
        ]
        found[case.name] = {
            "case": case,
            "files of the case": files,
            "record": paths[Path(case.record).stem],
            **common,
        }
    return found


FLIGHTS = "flights"
"""Stage of the flights of single models: when one model changed, the others are not flown again, although every result is judged anew."""


@dataclass(frozen=True)
class StoredFlights:
    """Flights in the store of a match, by a key of model and job (`pom.fmu.run_cache`).

    Attributes
    ----------
    store : StageStore
    fresh : bool
        Whether all are flown, whatever is kept.
    """

    store: StageStore
    fresh: bool = False

    def read(self, key: str, shape: tuple[int, int]) -> np.ndarray | None:
        """Return what is kept under a key; None when nothing is, or nothing of that shape."""
        for values in () if self.fresh else self.store.read(FLIGHTS, key):
            if values.shape == shape:
                return values
        return None

    def write(self, key: str, values: np.ndarray) -> None:
        """Keep an array under a key."""
        self.store.write(FLIGHTS, key, values)


def replay_cases(
    stages: Stages,
    inputs: Mapping[str, Mapping[str, Any]],
    cases: Sequence[Any],
    fmus: Mapping[str, Path],
    paths: Mapping[str, Kept[Any]],
    scheduler: str | None = None,
    **options: Any,
) -> list[PomResult]:
    """Return the results of all cases in their order; those that are kept are neither flown nor
    judged.

    Parameters
    ----------
    inputs : mapping of str to mapping
        From `of_cases`.
    cases, fmus, paths, scheduler, **options
        As `pom.replay_all`; paths as in `of_cases`.
    """
    named = {case.name: case for case in cases}
    flights = None  # workers of a cluster do not have the store
    if stages.store is not None and scheduler is None:
        flights = StoredFlights(stages.store, stages.fresh)

    def compute(missing: list[str], put: Callable[..., None]) -> None:
        def progress(result: PomResult) -> None:
            # a flight that failed may have failed for want of time: it is tried again
            put(result.case.name, result, keep=not result.failure)

        pom.replay_all(
            [named[name] for name in missing],
            fmus,
            Values(paths),
            scheduler=scheduler,
            flights=flights,
            progress=progress,
            **options,
        )

    return [kept.value for kept in stages.batch("replay", inputs, compute).values()]


def add_model_samples(
    stages: Stages,
    inputs: Mapping[str, Mapping[str, Any]],
    results: Sequence[PomResult],
    fmus: Mapping[str, Path],
    databases: Mapping[str, Path],
    paths: Mapping[str, Kept[Any]],
    options: Mapping[str, Any],
    jobs: int,
) -> list[PomResult]:
    """Return results with the samples of the models whose databases are given.

    Parameters
    ----------
    inputs : mapping of str to mapping
        From `of_cases`.
    results : sequence of PomResult
    databases : mapping of str to path
        As `pom.replay_sampled`.
    options : mapping
        ``count``, ``seed``, ``errors`` and ``names`` of `pom.replay_sampled`.
    jobs : int
        Threads of each case.
    """
    cases = {result.case.name: result.case for result in results if not result.case.law}
    drawn = {name: {**inputs[name], **options} for name in cases}

    def arguments(name: str) -> tuple[Any, ...]:
        case = cases[name]
        return (
            case,
            paths[Path(case.record).stem].value,
            dict(fmus),
            dict(databases),
            dict(options),
            jobs,
        )

    found = stages.each("samples", drawn, samples_of_case, arguments, 1, threads=stages.local)
    return [
        replace(one, samples=found[one.case.name].value) if one.case.name in found else one
        for one in results
    ]
