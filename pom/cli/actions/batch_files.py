"""Files of the command ``run``: hashed, read and checked before the first flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flightmech.errors import SchemaError, UnknownName
from flightmech.quantities import finite_number
from flightmech.support.console import InputFile, count_text, show_progress
from flightmech.support.kept_stages.sharing import demand_scheduler
from pom.archive.archive import Custody
from pom.archive.recordings import RecordingFiles, is_recording, read_recorded_runs, recording_files
from pom.cases.case import PomCase, read_case
from pom.cases.own_table import demand_use
from pom.checking.batch_check import check_batch
from pom.checking.case_check import RecordCheck
from pom.cli.actions.report import case_files, print_record_errors
from pom.cli.actions.run_options import RunOptions
from pom.cli.actions.tune import tuning_logs
from pom.fmu.models import Models
from pom.replaying.recorded_runs import RecordedRuns
from pom.replaying.replay_case import files_by_name
from pom.tolerances.own_tables import read_own_table


@dataclass(frozen=True)
class BatchFiles:
    """Cases and files of the command ``run``.

    Attributes
    ----------
    cases : list of PomCase
    runs, names, databases : dict of str to Path
        By model: its FMU, its table of names, and the database of its draws.
    recordings : RecordingFiles
        Recordings of devices and masters.
    recorded : dict of str to RecordedRuns
        By case: what they hold.
    logs : dict of str to dict
        By model: the log of its tuning.
    files : list of str
        Every input file but the FMUs, with repetitions.
    custody : Custody
        Hashes of all files, computed before they were read.
    """

    cases: list[PomCase]
    runs: dict[str, Path]
    names: dict[str, Path]
    recordings: RecordingFiles
    recorded: dict[str, RecordedRuns]
    databases: dict[str, Path]
    logs: dict[str, dict[str, Any]]
    files: list[str]
    custody: Custody

    @property
    def models(self) -> list[str]:
        """Models that are judged: FMUs and recordings, without the masters."""
        return [*self.runs, *self.recordings.runs]

    @property
    def single_files(self) -> dict[str, Path]:
        """Files of the models that have one; the files of a folder are among the inputs alone."""
        recordings = self.recordings.runs.items()
        return {**self.runs, **{name: file for name, file in recordings if not file.is_dir()}}

    @property
    def size_texts(self) -> tuple[str, str]:
        """Number of models and of cases, as texts."""
        return count_text(len(self.models), "model"), count_text(len(self.cases), "case")


def read_batch(options: RunOptions) -> BatchFiles:
    """Hash and read the cases and files of a batch."""
    given = files_by_name("--model", options.models, "final=out/final.fmu")
    runs = {name: file for name, file in given.items() if not is_recording(file)}
    recordings = _recordings_of(given, runs, options)
    names = files_by_name("--names", options.tables, "simulator=names.toml")
    sources = files_by_name("--database", options.databases, "final=out/final.nc")
    log_files = files_by_name("--tuning", options.tunings, "tuned=out/tuning.json")
    tolerances = options.tolerances_file
    paths = case_files(options.cases)
    named = [*names.values(), *sources.values(), *log_files.values()]
    for file in (*runs.values(), *named, *recordings.runs.values(), *recordings.masters.values()):
        # raises if the file is missing
        if not file.is_dir() or file in (*runs.values(), *named):
            InputFile().convert(file, None, None)
    # Every file is hashed before it is read, so that the hash belongs to the results.
    custody = Custody()
    custody.take([*paths, *runs.values()])
    if tolerances:
        custody.take([tolerances])
    with show_progress(f"read {count_text(len(paths), 'case')}"):
        table = read_own_table(tolerances) if tolerances else None
        read = [read_case(path, table) for path in paths]
    demand_use(table, [case.tolerances for case in read])
    files: list[str] = []
    for case in read:
        files += case.files()
    files += [*map(str, named), *filter(None, (options.evidence, options.biases_file))]
    files += [str(file) for file in recording_files(recordings, read)]
    custody.take(files)
    recorded_runs = read_recorded_runs(recordings, names, read)
    return BatchFiles(
        cases=read,
        runs=runs,
        names={name: table for name, table in names.items() if name not in recordings.runs},
        recordings=recordings,
        recorded=recorded_runs,
        databases=sources,
        logs=tuning_logs(log_files, runs),
        files=files,
        custody=custody,
    )


def _recordings_of(
    given: Mapping[str, Path], runs: Mapping[str, Path], options: RunOptions
) -> RecordingFiles:
    """Return the recordings among the models, with the masters of all models."""
    recordings = {name: file for name, file in given.items() if name not in runs}
    reports = files_by_name("--master", options.masters, "device=master/results.nc")
    for name in reports:
        if name not in given:
            raise UnknownName(name, given, "model", "--master names a run of --model")
    starts = _parse_starts(options.starts, recordings)
    return RecordingFiles(recordings, starts, reports, options.recurrent_share)


def _parse_starts(words: Sequence[str], runs: Mapping[str, Path]) -> dict[str, float]:
    """Return the instants of ``--start NAME=SECONDS`` by run.

    Raises
    ------
    SchemaError
        A word has no name of a recording or no number.
    """
    starts, problems = {}, []
    for word in words:
        name, _, text = word.partition("=")
        try:
            starts[name] = finite_number(text)
        except ValueError:
            problems.append(f"{word!r}: write NAME=SECONDS, such as device=0")
            continue
        if name not in runs:
            problems.append(f"{word!r}: {UnknownName(name, runs, 'recording of --model')}")
    if problems:
        raise SchemaError("--start", problems)
    return starts


def check_files(
    batch: BatchFiles, *, jobs: int, scheduler: str | None, resume: Path | None
) -> dict[str, RecordCheck]:
    """Check the cases and records of a batch, and print the errors of the records."""
    if scheduler:
        demand_scheduler(scheduler)
    with show_progress("check the cases and their records"):
        models = Models(batch.runs, batch.names)
        # the workers of a cluster load the FMUs, so this machine need not
        if not scheduler:
            models.demand_platform()
        checks = check_batch(batch.cases, models, jobs=jobs, folder=resume)
    print_record_errors(checks)
    return checks
