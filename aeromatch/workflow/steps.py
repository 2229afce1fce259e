"""The main job of a project: identification, replay of the cases, and the output folder."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import aerodb
import pom
from aerodb.figures.lr743_set.flown import FLOWN
from aerodb.update.cautions.control_sizes import sizes_text
from aeromatch.project.project import Project
from aeromatch.rebuilding.match_options import MatchOptions
from aeromatch.rebuilding.products import (
    MatchOutcome,
    add_model_samples,
    model_files,
    of_cases,
    replay_cases,
    write_files,
)
from aeromatch.workflow.devices import read_devices
from aeromatch.workflow.flown import flown_tree
from aeromatch.workflow.identification import Step, run_identification
from aeromatch.workflow.identified import Identified
from aeromatch.workflow.outputs import COMPARED, REPORT, replay_step
from aeromatch.workflow.windows import inputs_of, rests_on
from flightmech.aircraft.parts import different_parts
from flightmech.support.array_files.netcdf_writing import encode_netcdf
from flightmech.support.atomic_write import folder_written_atomically, resolve_folder
from flightmech.support.kept_stages.sharing import open_cluster
from flightmech.support.kept_stages.stages import Kept, Stages, Values
from pom.archive.origins import ReportProvenance
from pom.cases.signatures import plain_signatures
from pom.checking.case_check import checks_text, codes_text, with_record_checks
from pom.checking.report_checks import with_report_checks
from pom.diagnosis.corrected_model import joint_terms
from pom.diagnosis.term_swaps import by_submodel, differing_terms

# Names of all files that a match writes into its folder.
_OUTPUT_NAMES = re.compile(
    r"(datcom|corrected|final)(\.nc|\.toml|\.fmu|_engine\d+\.nc|_fuel\.nc)"
    rf"|{re.escape(FLOWN)}|{re.escape(COMPARED)}"
)


def perform_match(
    project: Project,
    folder: str | Path,
    jobs: int,
    step: Step,
    command: str = "",
    options: MatchOptions | None = None,
    stages: Stages | None = None,
) -> MatchOutcome:
    """Do the whole job of a project and write databases, FMUs and report into a folder.

    The folder is replaced as a whole at the end. Its databases, FMUs and report are therefore
    always results of one job.

    Parameters
    ----------
    project : Project
    folder : path
        Gets ``datcom.nc corrected.nc final.nc``, their aircraft as ``.toml``, both as ``.fmu``,
        ``flown.nc`` (data of the identification, for the figures of LR-743), and ``report/``.
        Other files in the folder stay.
    jobs : int
        Processes for reconstruction, diagnosis and replay, threads for the other steps; -1 is one
        per core.
    step : callable
        ``with step("text"):`` surrounds every step, for progress.
    command : str
        Command line, for the report.
    options : MatchOptions, optional
        Cluster, stored flights, draws and comparison of the tables. The default is none of them.
    stages : Stages, optional
        Storage of the results of stages. Without it no result is stored. The files have the same
        bytes in both cases.

    Returns
    -------
    MatchOutcome

    Raises
    ------
    OSError
        The folder cannot be replaced
        (`flightmech.support.atomic_write.folder_written_atomically`).
    SimulationError
        As `flightmech.support.kept_stages.sharing.open_cluster`.
    """
    folder = Path(folder)
    if folder.parent.is_dir():
        # An error of the folder is raised before the long computations.
        resolve_folder(folder)
    stages = stages or Stages()
    options = options or MatchOptions()
    cluster = open_cluster(options.scheduler) if options.scheduler else nullcontext(stages.workers)
    with cluster as stages.workers:
        result = run_identification(
            project, jobs, step=step, stages=stages, compare=options.compare_tables
        )
        folder.parent.mkdir(parents=True, exist_ok=True)
        with folder_written_atomically(folder, _is_output) as new:
            with step("write three databases, aircraft and FMUs"):
                # Made once: without a store, a second request would compute it again.
                evidence = _make_evidence(result, stages)
                fmus = _write_models(result, evidence.value[0], new, stages)
            # The report states the hashes of the FMUs that the replay reads.
            result.custody.take(fmus.values())
            with step(replay_step(len(result.cases), len(fmus), len(project.devices))):
                replays = _replay_cases(
                    result, fmus, new, jobs=jobs, options=options, stages=stages
                )
            # No file may have changed between its identification and its replay.
            result.custody.check()
            replays = with_report_checks(with_record_checks(replays, Values(result.checks)))
            # A report proves something by at least one case.
            if replays:
                with step("write the report"):
                    pom.write_report(
                        replays,
                        new / REPORT,
                        title=f"{project.title}: Proof of Match",
                        provenance=_provenance(result, fmus, command),
                        diagnoses=result.diagnoses,
                        kept=_make_chapters(result, evidence, stages).value,
                        chapters=project.chapters,
                        jobs=jobs,
                        stages=stages,
                    )
    stages.close()
    return _summarise(result, replays, folder)


def _replay_cases(
    result: Identified,
    fmus: Mapping[str, Path],
    folder: Path,
    *,
    jobs: int,
    options: MatchOptions,
    stages: Stages,
) -> list[Any]:
    """Return the results of the cases, with the samples of the final model if requested."""
    project = result.project
    final = result.databases["final"]
    recorded = read_devices(project, result.cases)
    inputs = of_cases(
        result.cases,
        result.paths,
        fmus,
        tables=project.tables,
        evidence=final,
        content=result.content,
        recorded=recorded,
    )
    # Without cases the final database need not be in memory.
    judged_by: dict[str, Any] = {}
    if result.cases:
        judged_by = {"names": project.tables, "evidence": final.value, "recorded": recorded}
    replays = replay_cases(
        stages,
        inputs,
        result.cases,
        fmus=fmus,
        paths=result.paths,
        jobs=jobs,
        scheduler=options.scheduler,
        resume=options.resume,
        **judged_by,
    )
    if not options.samples:
        return replays
    return add_model_samples(
        stages,
        inputs,
        replays,
        fmus=fmus,
        databases={"final": folder / "final.nc"},
        paths=result.paths,
        options={
            "count": options.samples,
            "seed": options.seed,
            "errors": project.errors,
            "names": project.tables,
        },
        jobs=jobs,
    )


def _provenance(result: Identified, fmus: Mapping[str, Path], command: str) -> ReportProvenance:
    """Return the provenance of the report: files with hashes, records, faults, signatures."""
    project = result.project
    provenance = pom.provenance(
        inputs_of(project, result.records, result.cases),
        fmus,
        command,
        digest=result.custody.sha256,
    )
    sources = rests_on(project, result.windows, result.cases)
    if result.left_out:
        sources["faulty samples"] = "; ".join(result.left_out)
    codes = codes_text(Values(result.checks).values())
    if codes:
        sources["codes of missing values"] = codes
    sizes = sizes_text(result.tables.value[1].controls)
    if sizes:
        sources["size of the controls"] = sizes
    provenance["records"] = sources
    errors = checks_text(Values(result.checks).values())
    if errors:
        provenance["record_errors"] = errors
    if project.signatures:
        provenance["signatures"] = plain_signatures(project.signatures)
    return provenance


def _make_evidence(result: Identified, stages: Stages) -> Kept[tuple[bytes, Any]]:
    """Return ``flown.nc``, and the 1 g lines of the final model at the flight conditions.

    Both are empty if no window of a record identifies the aerodynamics.
    """
    spans = result.windows.aerodynamic_spans()
    if not any(spans):
        return Kept(made=((b"", {}),))
    final, aircraft = result.databases["final"], result.aircraft["final"]

    def make() -> tuple[bytes, Any]:
        tree = flown_tree(
            aircraft.value.name,
            Values(result.data),
            spans,
            tables=result.marks.value[0],
            fits=result.all_fits(),
            submodels=result.submodels(),
        )
        # The lines are drawn at the flight conditions of the manoeuvres.
        conditions = tree["manoeuvres"].to_dataset().to_dataframe()
        lines, _ = aerodb.figures.one_g_lines(final.value, aircraft.value, conditions)
        return encode_netcdf(tree), lines

    inputs = {
        "coefficients": result.data,
        "spans": spans,
        "manoeuvres": result.marks,
        "fits": result.fits,
        **result.submodel_inputs(),
        "database": final,
        "aircraft": aircraft,
    }
    return stages.one("evidence", inputs, make)


def _write_models(
    result: Identified, evidence: bytes, folder: Path, stages: Stages
) -> dict[str, Path]:
    """Write databases, aircraft, FMUs and evidence, and return all FMUs by name.

    The FMUs of other origin in the project follow those of the project.
    """
    if result.compared is not None:
        result.compared.value.to_csv(folder / COMPARED)
    for name, database in result.databases.items():
        files = model_files(stages, name, database, result.aircraft[name])
        write_files(files.value, folder)
    if evidence:
        (folder / FLOWN).write_bytes(evidence)
    fmus = {name: folder / f"{name}.fmu" for name in result.databases}
    return fmus | result.project.fmus


def _make_chapters(
    result: Identified, evidence: Kept[tuple[bytes, Any]], stages: Stages
) -> Kept[Any]:
    """Return the chapters of the report in addition to its cases.

    `evidence` is the result of `_make_evidence`.
    """

    def make() -> Any:
        submodels = result.submodels()
        return pom.report.drawn_chapters(
            databases={name: stored.value for name, stored in result.databases.items()},
            diagnoses=result.diagnoses,
            fits=result.all_fits(),
            submodels=submodels.found,
            free_motion=submodels.free_motion,
            driven_motion=submodels.driven_motion,
            chapters=result.project.chapters,
            level_lines=evidence.value[1],
            ranking=result.ranking,
        )

    inputs = {
        "databases": result.databases,
        "fits": result.fits,
        "diagnoses": result.diagnoses,
        "ranking": result.ranking,
        "chapters": result.project.chapters,
        **result.submodel_inputs(),
        "evidence": evidence,
    }
    return stages.one("chapters", inputs, make)


def _summarise(result: Identified, replays: list[Any], folder: Path) -> MatchOutcome:
    """Return the outcome of a match whose folder is complete."""
    # The first database is the a-priori one, the last one is final.
    databases = [stored.value for stored in result.databases.values()]
    terms = differing_terms(databases[0], databases[-1])
    aircraft = [stored.value for stored in result.aircraft.values()]
    parts = different_parts(aircraft[0], aircraft[-1])
    corrected = pom.corrected_terms(result.diagnoses.values())
    record_errors: list[str] = []
    for check in result.checks.values():
        record_errors += check.value.lines()
    return MatchOutcome(
        results=replays,
        corrected_terms=corrected,
        corrected_submodels=by_submodel(corrected, *databases),
        joint_terms=joint_terms(result.diagnoses),
        ranking=result.ranking.sentences if result.ranking else [],
        prior_model=result.project.prior_model,
        differing=len(terms) + len(parts),
        tables=result.tables,
        report=folder / REPORT / "report.html" if replays else None,
        files=_list_outputs(folder),
        record_errors=record_errors,
        left_out=result.left_out,
    )


def _list_outputs(folder: Path) -> list[str]:
    """Return the files of a match in its output folder, relative to it and sorted."""
    files: list[str] = []
    for item in folder.iterdir():
        if _is_output(item.name):
            candidates = [item, *item.rglob("*")]
            files += [file.relative_to(folder).as_posix() for file in candidates if file.is_file()]
    return sorted(files)


def _is_output(name: str) -> bool:
    """Return whether a match writes a file or folder of this name into its output folder."""
    return name == REPORT or bool(_OUTPUT_NAMES.fullmatch(name))
