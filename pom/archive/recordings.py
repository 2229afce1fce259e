"""Recordings of devices and master reports: which file belongs to which case, and their runs."""

from __future__ import annotations

import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from flightmech.errors import SchemaError
from pom.archive.masters import archive_file, read_masters
from pom.cases.case import PomCase
from pom.replaying.recorded_runs import MasterRun, RecordedRun, RecordedRuns, read_recording


@dataclass(frozen=True)
class RecordingFiles:
    """Recordings and masters as the user names them.

    Attributes
    ----------
    runs : dict of str to Path
        By run: the recording, or a folder with one recording for each case, named after it.
    starts : dict of str to float
        By run: instant of the recording at the start of the window of a case. [s]
    masters : dict of str to Path
        By run: the earlier report.
    share : float or None
        Criterion of the recurrent tests; None for that of the rule.
    """

    runs: Mapping[str, Path] = field(default_factory=dict)
    starts: Mapping[str, float] = field(default_factory=dict)
    masters: Mapping[str, Path] = field(default_factory=dict)
    share: float | None = None


def is_recording(file: Path) -> bool:
    """Return whether the file of a model is a recording: a folder, or a file that is not an FMU."""
    if file.is_dir():
        return True
    return file.suffix.lower() != ".fmu" and not zipfile.is_zipfile(file)


def recording_files(files: RecordingFiles, cases: Sequence[PomCase]) -> Iterator[Path]:
    """Yield every file that recordings and masters read."""
    for name, path in files.runs.items():
        if not path.is_dir() and len(cases) > 1:
            raise SchemaError(
                f"model {name}: {path}",
                [
                    f"one recording and {len(cases)} cases; give a folder with a recording for "
                    f"each case, named after it, or one case"
                ],
            )
        for case in cases:
            yield find_recording(path, case)
    for path in files.masters.values():
        yield archive_file(path)


def find_recording(path: Path, case: PomCase) -> Path:
    """Return the recording of a case: the file, or the file of a folder with the name of the case.

    Raises
    ------
    SchemaError
        The folder has no such file, or several.
    """
    if not path.is_dir():
        return path
    fitting = []
    for file in sorted(path.iterdir()):
        if file.is_file() and file.suffix != ".toml" and file.name.split(".")[0] == case.name:
            fitting.append(file)
    if len(fitting) == 1:
        return fitting[0]
    found = ", ".join(file.name for file in fitting) or "none"
    raise SchemaError(
        f"recordings {path}",
        [f"case {case.name}: needs one recording with this name, such as {case.name}.csv; {found}"],
    )


def read_recorded_runs(
    files: RecordingFiles, names: Mapping[str, Path], cases: Sequence[PomCase]
) -> dict[str, RecordedRuns]:
    """Return the recorded runs and the masters of every case by its name; empty without any.

    Raises
    ------
    SchemaError
        Two cases have one name, which would share a recording, or as `read_recording`.
    """
    if not files.runs and not files.masters:
        return {}
    counts = Counter(case.name for case in cases)
    repeated = [name for name, count in counts.items() if count > 1]
    if repeated:
        raise SchemaError(
            "recordings",
            [f"case name {name!r} is given twice; rename one of the cases" for name in repeated],
        )
    runs: dict[str, dict[str, RecordedRun]] = {case.name: {} for case in cases}
    masters: dict[str, dict[str, MasterRun]] = {case.name: {} for case in cases}
    for name, path in files.runs.items():
        for case in cases:
            table = names.get(name) or case.models.get(name)
            runs[case.name][name] = read_recording(
                find_recording(path, case), case, table, files.starts.get(name)
            )
    for name, path in files.masters.items():
        for case_name, master in read_masters(path, name, cases, files.share).items():
            masters[case_name][name] = master
    return {case.name: RecordedRuns(runs[case.name], masters[case.name]) for case in cases}
