"""Whether the files of a project are those of its match.

A data package states what a match proved.  A file that was edited later, or a match of another
project, would put numbers into one package that do not belong together.
"""

from __future__ import annotations

from pathlib import Path

from aeromatch.project.project import Project
from aeromatch.workflow.outputs import REPORT
from aeromatch.workflow.windows import inputs_of
from flightmech.errors import SchemaError
from flightmech.support.input_files import file_sha256
from pom.archive.origins import read_report_manifest
from pom.archive.statements import run_of
from pom.cases.case import read_case

_MOST_FILES = 10  # listed


def demand_match_of_project(project: Project, match: Path) -> None:
    """Raise if a file of a project is not the one that its match used.

    Parameters
    ----------
    project : Project
    match : Path
        Folder of `aeromatch match`; the manifest of its report has the hashes of its inputs.

    Raises
    ------
    SchemaError
        With the files that were changed, or that the match did not use.
    """
    statement = read_report_manifest(match / REPORT)
    used: dict[str, set[str]] = {}
    for item in statement["predicate"]["buildDefinition"]["resolvedDependencies"]:
        if not run_of(item):
            used.setdefault(Path(item["name"]).name, set()).add(item["digest"]["sha256"])
    # a recording that no part of the match uses is not among its inputs
    names = [name for name, file in project.flights.items() if file.name in used]
    problems = []
    cases = [read_case(file) for file in project.cases]
    for file in dict.fromkeys(inputs_of(project, names, cases)):
        digest = file_sha256(file)
        matched = used.get(file.name, set())
        if digest in matched:
            continue
        if not matched:
            problems.append(f"{file}: the match did not use a file of this name")
            continue
        problems.append(
            f"{file}: it was changed after the match, or the match is of another project (SHA-256 "
            f"{digest[:12]}, the match used {', '.join(sorted(text[:12] for text in matched))})"
        )
    if not problems:
        return
    count = len(problems)
    if count > _MOST_FILES:
        problems = [*problems[:_MOST_FILES], f"and {count - _MOST_FILES} more files"]
    problems.append(
        f"the package would state what {match} did not prove: run `aeromatch match {project.file}` "
        f"again, or give the folder of the match of this project"
    )
    raise SchemaError(f"package of {project.file}", problems)
