"""Stages of the products of a match: files of the models, replays, samples."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import aerodb
import flightmech
import pom
from aerodb.update.cautions.notices import note_plausibility
from flightmech.errors import AeromatchWarning
from flightmech.simulation.compiler import compile_with_envelope
from flightmech.support.kept_stages.content_hashes import FileContent
from flightmech.support.kept_stages.stages import Kept, Stages, Values
from flightmech.support.kept_stages.store import StageStore
from pom.cases.case import PomCase
from pom.diagnosis.sampling.sampled_replay import samples_of_case
from pom.result import PomResult


@dataclass(frozen=True)
class MatchOutcome:
    """Outcome of `aeromatch.workflow.steps.perform_match`.

    Attributes
    ----------
    results : list of PomResult
        One per case.
    corrected_terms : list of str
        Terms and parts of the aircraft of the corrected model that come from the final model.
    corrected_submodels : dict of str to list of str
        These terms and parts by submodel: ``aerodynamics``, ``ground effect``,
        ``control loading``, ``engine``, ``landing gear``.
    joint_terms : dict of str to list of str
        Terms that no single case requires, by the case for which they were added. The terms of one
        case change the result of another case.
    differing : int
        Terms and parts that differ between the a-priori and the final model.
    tables : Kept
        Final database without its submodels, and the tabulation behind it.
    report : Path or None
        Of ``report.html``; None without a case.
    files : list of str
        All written files, relative to the output folder.
    record_errors : list of str
        Errors in the flight records, one line each.
    left_out : list of str
        Faulty samples in the windows, left out or not, one line each.
    ranking : list of str
        What the ranking of the terms over all cases states, one sentence each.
    prior_model : str
        Name of the a-priori model.
    """

    results: list[Any]
    corrected_terms: list[str]
    corrected_submodels: dict[str, list[str]]
    joint_terms: dict[str, list[str]]
    differing: int
    tables: Kept[tuple[Any, Any]]
    report: Path | None
    files: list[str]
    record_errors: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    ranking: list[str] = field(default_factory=list)
    prior_model: str = "datcom"

    @property
    def tabulation(self) -> Any:
        """The `Tabulation` of the final database, with the origin of the terms."""
        return self.tables.value[1]

    def to_dict(self) -> dict[str, Any]:
        """Return the verdicts as plain data."""
        return {
            "report": str(self.report) if self.report else None,
            "corrected_terms": self.corrected_terms,
            "corrected_submodels": self.corrected_submodels,
            "joint_terms": self.joint_terms,
            "record_errors": self.record_errors,
            "left_out": self.left_out,
            "ranking": self.ranking,
            "differing": self.differing,
            "warnings": list(self.tabulation.notices),
            "cases": [_case_record(result) for result in self.results],
        }


def _case_record(result: Any) -> dict[str, Any]:
    """Return the verdict of one case as plain data."""
    return {
        "name": result.case.name,
        "id": result.case.id,
        "status": {run: result.status(run) for run in result.runs},
        "verdict": result.verdict_records(),
        "failure": result.failure,
        "samples": {run: samples.numbers() for run, samples in result.samples.items()},
    }


def model_files(
    stages: Stages, name: str, database: Kept[Any], aircraft: Kept[Any]
) -> Kept[dict[str, bytes]]:
    """Return database, aircraft and FMU of a model as files by name.

    Warns
    -----
    AeromatchWarning
        A value of the database is implausible; its notices have it, too.
    """

    def make() -> dict[str, bytes]:
        tree, findings = note_plausibility(database.value, aircraft.value)
        for finding in findings:
            # The aircraft file is that of the final model; the others may lack its findings.
            is_unused = finding.kind == "unused" and name == "final"
            if finding.kind == "implausible" or is_unused:
                warnings.warn(f"{name}: {finding}", AeromatchWarning, stacklevel=2)
        with TemporaryDirectory() as temporary:
            folder = Path(temporary)
            aerodb.save(tree, folder / f"{name}.nc")
            flightmech.write_aircraft(aircraft.value, folder / f"{name}.toml")
            model = compile_with_envelope(aircraft.value, tree)
            flightmech.write_fmu(model, folder / f"{name}.fmu")
            # An aircraft writes further files, such as the tables of its engines.
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
    recorded: Mapping[str, Any],
) -> dict[str, dict[str, Any]]:
    """Return all inputs of the replay of every case, by name of the case.

    Parameters
    ----------
    cases : sequence of PomCase
    paths : mapping of str to Kept
        Reconstructed paths by record.
    fmus, tables : mapping of str to path
        Models, and the tables of names of the models that have one.
    evidence : Kept of DataTree
    content : callable
        Returns the content of a file.
    recorded : mapping of str to RecordedRuns
        Recordings of devices by case; a case may have none.
    """
    # Files count by their content, so that a copy in another folder is the same.
    common = {
        "models": [(name, content(file)) for name, file in fmus.items()],
        "names of models": [(name, content(file)) for name, file in tables.items()],
        "evidence": evidence,
    }
    inputs: dict[str, dict[str, Any]] = {}
    for case in cases:
        case_inputs = {
            "case": case.without_texts(),
            "files of the case": case.contents(),
            "record": paths[Path(case.record).stem],
        }
        if case.name in recorded:
            case_inputs["recorded"] = recorded[case.name]
        inputs[case.name] = case_inputs | common
    return inputs


FLIGHTS = "flights"
"""Stage of the simulations of single models.

After a change of one model the other models are not simulated again, but every result is judged
again.
"""


@dataclass(frozen=True)
class StoredFlights:
    """Simulations in the store of a match, by a key of model and job (`pom.fmu.run_cache`).

    Attributes
    ----------
    store : StageStore
    fresh : bool
        Whether all simulations are done again.
    """

    store: StageStore
    fresh: bool = False

    def read(self, key: str, shape: tuple[int, int]) -> np.ndarray | None:
        """Return the array of a key, or None if the store has no array of this shape."""
        if self.fresh:
            return None
        for values in self.store.read(FLIGHTS, key):
            if values.shape == shape:
                return values
        return None

    def write(self, key: str, values: np.ndarray) -> None:
        """Store an array."""
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
    """Return the results of all cases in order. A stored result is not computed again.

    Parameters
    ----------
    stages : Stages
    inputs : mapping of str to mapping
        From `of_cases`.
    cases, fmus, scheduler, **options
        As in `pom.replay_all`.
    paths : mapping of str to Kept
        Reconstructed paths by record.
    """
    # Without the texts of their pages, so that no stored result depends on them.
    cases_by_name = {case.name: case.without_texts() for case in cases}
    # The workers of a cluster do not have the store.
    flights = None
    if stages.store is not None and scheduler is None:
        flights = StoredFlights(stages.store, stages.fresh)

    def compute(missing: list[str], put: Callable[..., None]) -> None:
        def progress(result: PomResult) -> None:
            # A simulation may fail because its time is limited, so it is tried again.
            put(result.case.name, result, keep=not result.failure)

        pom.replay_all(
            [cases_by_name[name] for name in missing],
            fmus,
            Values(paths),
            scheduler=scheduler,
            flights=flights,
            progress=progress,
            **options,
        )

    replays = stages.batch("replay", inputs, compute)
    return [replays[case.name].value.with_case(case) for case in cases]


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
    """Return the results with random samples of some models.

    A case with the FMU of a control law has no samples.

    Parameters
    ----------
    stages : Stages
    inputs : mapping of str to mapping
        From `of_cases`.
    results : sequence of PomResult
    fmus : mapping of str to path
    databases : mapping of str to path
        Databases of the sampled models, as in `pom.replay_sampled`.
    paths : mapping of str to Kept
        Reconstructed paths by record.
    options : mapping
        ``count``, ``seed``, ``errors`` and ``names`` of `pom.replay_sampled`.
    jobs : int
        Threads of each case.
    """
    cases: dict[str, PomCase] = {}
    for result in results:
        if not result.case.law:
            cases[result.case.name] = result.case.without_texts()
    sample_inputs = {name: {**inputs[name], **options} for name in cases}

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

    # Each case uses `jobs` threads, so the cases are computed one after the other.
    samples = stages.each(
        "samples",
        sample_inputs,
        samples_of_case,
        arguments=arguments,
        jobs=1,
        threads=stages.local,
    )
    sampled: list[PomResult] = []
    for result in results:
        name = result.case.name
        if name in samples:
            result = replace(result, samples=samples[name].value)
        sampled.append(result)
    return sampled
