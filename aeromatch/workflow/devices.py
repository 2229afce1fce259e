"""Recordings of the devices of a project, read for its cases."""

from __future__ import annotations

from collections.abc import Sequence

from aeromatch.project.project import Project
from flightmech.errors import SchemaError
from pom.archive.masters import read_masters
from pom.cases.case import PomCase
from pom.replaying.recorded_runs import MasterRun, RecordedRun, RecordedRuns, read_recording


def read_devices(project: Project, cases: Sequence[PomCase]) -> dict[str, RecordedRuns]:
    """Return the recorded runs and masters by case; a case without a recording is left out.

    Raises
    ------
    SchemaError
        A recording has the name of none of the cases, or as `read_recording` and `read_masters`.
    OutOfRange
        A recording does not cover the window of its case.
    """
    names = [case.name for case in cases]
    problems: list[str] = []
    for name, device in project.devices.items():
        problems += device.problems(f"devices.{name}", names)
    if problems:
        raise SchemaError(str(project.file), problems)
    runs: dict[str, dict[str, RecordedRun]] = {}
    masters: dict[str, dict[str, MasterRun]] = {}
    for name, device in project.devices.items():
        recorded = [case for case in cases if case.name in device.recordings]
        for case in recorded:
            file = device.recordings[case.name]
            run = read_recording(file, case, device.names, device.start)
            runs.setdefault(case.name, {})[name] = run
        if device.master is not None:
            found = read_masters(device.master, name, recorded, device.recurrent_share)
            for case_name, master in found.items():
                masters.setdefault(case_name, {})[name] = master
    return {case: RecordedRuns(items, masters.get(case, {})) for case, items in runs.items()}
