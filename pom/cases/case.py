"""Proof-of-Match case: a test of the tolerance table, a window of a record, and the drive."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from flightmech.aircraft.aircraft_file import aircraft_files
from flightmech.errors import SchemaError
from flightmech.short_text import ShortText
from flightmech.support.kept_stages.content_hashes import FileContent
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import validate_content
from pom.cases import resolve as parts
from pom.cases.case_checks import check_case_names, check_table_names, loose_problems
from pom.cases.case_facts import resolve_facts
from pom.cases.case_file import INPUTS, LEVERS, SHOWN, CaseFile
from pom.cases.case_inputs import PRIMARY, CaseInputs, resolve_drive
from pom.cases.own_table import find_own_table, table_excerpt
from pom.cases.signatures import plain_signatures
from pom.tolerances import rows
from pom.tolerances.criteria import Criterion
from pom.tolerances.own_tables import OwnTable

_POWER = {
    "thrust": ("thrust",),
    "n1": ("n1",),
    "throttle": ("throttle", "pla"),
    "torque": ("torque",),
    "rpm": ("rpm", "throttle", "pla"),
    "map": ("manifold_pressure",),
    "none": (),
}
"""By drive of the engines: the quantities that it sets.  The angle of a lever is its position."""

_MOST_ENGINES = 8
# fields of a case that only its page prints
_TEXTS = ("title", "description", "objective", "procedure", "manual", "evaluation", "notes")


@dataclass(frozen=True)
class PomCase(ShortText):
    """Case of Proof-of-Match: the content of a case file with defaults, criteria and windows.

    Attributes
    ----------
    name, title, description : str
    id, standard, edition : str
        Test, standard and edition of the tolerance table.
    path, record, names, aircraft : str
        The case file, the flight record, its name map and the aircraft file.
    tolerances : str
        Tolerance table of the user from which the rows are; empty for ``tolerances.csv``.
    table : dict of str to Any
        What the report needs of this table (`OwnTable.excerpt`); empty without one.
    window : tuple of float
        Start and end of the replay on the clock of the record. [s]
    drive : CaseInputs
    conditions : dict of str to float
        Values of the case file that replace recorded ones. [SI]
    events : dict of str to float
        Instants that bound windows: ``input_end``, ``change_start`` ... [s]
    features : tuple of str
        Conditions of table rows that the aeroplane meets, for example ``reversible_controls``.
    facts : dict of str to Any
        Known facts of the aircraft, of its file and of the case
        (`flightmech.aircraft.facts.AircraftFacts`). [SI]
    additional : str
        Why the case is flown in another configuration than its row asks; empty if it is not.
    absent : tuple of str
        Parameters of rows whose equipment the case file alone states as missing.
    shortened : str
        Reason for a window that is shorter than the table requires; empty if none is.
    show : tuple of str
        Channels to show in addition to the judged ones.
    criteria : tuple of Criterion
    reference : str
        ``flight``; ``engineering``: data of an engineering simulator; ``footprint``: a recording
        without a reference, which has no band and no verdict.
    fraction : float
        Share of the tolerance that is applied. [1]
    wind : str
        ``record``: the wind of the reconstruction; ``measured``: the wind of the raw record;
        ``none``: calm air.
    ranges : dict of str to float
        Largest value in service by channel, the base of lone percentages (``range_max``, rule R3).
        [SI]
    certified : dict of str to float
        Certified value by parameter.  A criterion fails below it, even inside its band (climb
        gradients of 1.c.2, 1.c.4). [SI]
    ticks : dict of str to str
        By advisory criterion: name, date and remark of the engineer who ticked it.
    rationale : dict of str to str
        By criterion or channel: reason for a deviation.
    source : dict of str to str
        Origin of the flight data: document, pages, flight, run, filters ...
    compliance : dict of str to str
        Statements of compliance by subject.
    signatures : dict of str to dict
        Signatures on the pages of the case by role: ``name``, ``date``, ``organisation``.
    models : dict of str to str
        By model: the table of its names, if its names, units or signs are not the canonical ones.
    law, law_names : str
        FMU of the control law and the table of its names; empty for none.
    law_moves : tuple of str
        Controls that the control law moves, in place of the record.
    objective, procedure, manual, evaluation, notes : str
        Purpose of the test, its automatic and manual procedure, its evaluation, remarks.
    """

    name: str
    title: str
    id: str
    standard: str
    edition: str
    path: str
    record: str
    window: tuple[float, float]
    description: str = ""
    names: str = ""
    aircraft: str = ""
    tolerances: str = ""
    table: dict[str, Any] = field(default_factory=dict)
    drive: CaseInputs = field(default_factory=CaseInputs)
    conditions: dict[str, float] = field(default_factory=dict)
    events: dict[str, float] = field(default_factory=dict)
    features: tuple[str, ...] = ()
    facts: dict[str, Any] = field(default_factory=dict)
    additional: str = ""
    absent: tuple[str, ...] = ()
    shortened: str = ""
    show: tuple[str, ...] = SHOWN
    criteria: tuple[Criterion, ...] = ()
    reference: str = "flight"
    fraction: float = 1.0
    wind: str = "record"
    ranges: dict[str, float] = field(default_factory=dict)
    certified: dict[str, float] = field(default_factory=dict)
    ticks: dict[str, str] = field(default_factory=dict)
    rationale: dict[str, str] = field(default_factory=dict)
    source: dict[str, str] = field(default_factory=dict)
    compliance: dict[str, str] = field(default_factory=dict)
    signatures: dict[str, dict[str, str]] = field(default_factory=dict)
    models: dict[str, str] = field(default_factory=dict)
    law: str = ""
    law_names: str = ""
    law_moves: tuple[str, ...] = ()
    objective: str = ""
    procedure: str = ""
    manual: str = ""
    evaluation: str = ""
    notes: str = ""

    def files(self) -> list[str]:
        """Return the case file and the files that it names."""
        inputs = (self.path, self.record, self.names, self.aircraft, self.tolerances)
        names = (*inputs, *self.models.values(), self.law, self.law_names)
        # a file that the case does not name is an empty text
        return [name for name in names if name]

    def contents(self) -> list[FileContent]:
        """Return the files that replay, diagnosis and verdict of the case read, with their hashes.

        The case file is not among them: the case holds all that it states.  The record is, if its
        wind is read from it; a reconstructed path holds the rest of the record.  A missing file is
        left out, because its reader reports it.
        """
        names = [self.names, *self.models.values(), self.law, self.law_names]
        if self.wind == "measured":
            names.append(self.record)
        files = [Path(name) for name in names if name]
        if self.aircraft and Path(self.aircraft).is_file():
            files += aircraft_files(self.aircraft)
        return [FileContent.of(file) for file in files if file.is_file()]

    def printed_rows(self) -> list[rows.Row]:
        """Return the rows of the test in the table of the case.

        Raises
        ------
        UnknownName
            The table of this version has no such standard, edition or test.
        """
        return rows.rows_of_test(self.id, self.standard, self.edition, self.table.get("rows", ()))

    @property
    def edition_words(self) -> str:
        """Edition as a report prints it, with the table of the user that holds it."""
        if not self.table:
            return self.edition
        return f"{self.edition}, tolerances of {self.table['file']} ({self.table['sha256'][:12]})"

    @property
    def is_demonstration(self) -> bool:
        """Whether the case shows curves without a tolerance: all rows that apply are such."""
        measures = {criterion.measure for criterion in self.criteria if criterion.applies}
        return measures == {"demonstration"}

    def without_texts(self) -> PomCase:
        """Return the case without the texts that only its page prints.

        Simulations and verdicts do not depend on them, so that a change of a title repeats none.
        """
        empty: dict[str, Any] = dict.fromkeys(_TEXTS, "")
        return replace(self, source={}, compliance={}, signatures={}, **empty)

    def to_dict(self) -> dict[str, Any]:
        """Return the case as plain data."""
        return asdict(self)

    @classmethod
    def from_dict(cls, item: Mapping[str, Any]) -> PomCase:
        """Rebuild a case from `to_dict`."""
        # JSON has lists in place of tuples
        fields = dict(item)
        fields["window"] = (item["window"][0], item["window"][1])
        fields["drive"] = CaseInputs.from_dict(item["drive"])
        fields["features"] = tuple(item["features"])
        fields["absent"] = tuple(item.get("absent", ()))
        fields["show"] = tuple(item["show"])
        fields["law_moves"] = tuple(item.get("law_moves", ()))
        fields["criteria"] = tuple(Criterion.from_dict(content) for content in item["criteria"])
        return cls(**fields)


def driven_quantities(case: PomCase) -> set[str]:
    """Return the quantities that the record sets, which therefore cannot be judged.

    Controls of the math pilot or of a control law are not among them.
    """
    # of the controls of pitch, roll and yaw only one level drives the model
    names = set(INPUTS).difference(*PRIMARY.values()).union(PRIMARY[case.drive.level])
    # controls that are computed during the run, not read from the record
    computed = {loop.control for loop in case.drive.pilot}.union(case.law_moves)
    if "throttle" not in computed:
        for number in range(1, _MOST_ENGINES + 1):
            names |= {f"engine{number}.{name}" for name in _POWER[case.drive.engine]}
            if case.drive.engine != "thrust":
                names |= {f"engine{number}.{name}" for name in LEVERS}
            if case.drive.propeller == "rpm":
                names.add(f"engine{number}.rpm")
                # torque and speed of the record give the power
                if case.drive.engine == "torque":
                    names.add(f"engine{number}.shaft_power")
    return names - computed


def read_case(path: str | Path, table: OwnTable | None = None) -> PomCase:
    """Read a case file and resolve it against the tolerance table.

    Parameters
    ----------
    path : str or Path
        TOML file; `docs/explanation/proof-of-match/cases.md` describes it.  Files that it names are
        relative to it.
    table : OwnTable, optional
        Tolerance table of the user (`read_own_table`).  It replaces the table that the case names.
        A case whose standard and edition it does not hold keeps its own table.

    Raises
    ------
    ParseError
        The file is not TOML.
    SchemaError
        With every problem of the file: unknown keys and their near names, units, events without a
        time, windows, a math pilot on a judged channel.
    """
    path = Path(path)
    content = read_toml(path)
    try:
        file = validate_content(CaseFile, content, f"case {path}")
    except SchemaError as error:
        # Check the sound part of the file as well, so that all problems are reported at once.
        sound_part = parts.sound_rest(content)
        if sound_part is None:
            others = loose_problems(content)
        else:
            others = _resolve_case(path, sound_part, table)[1]
        new = [text for text in others if text not in error.problems]
        raise SchemaError(error.what, [*error.problems, *new]) from None
    case, problems = _resolve_case(path, file, table)
    if problems:
        raise SchemaError(f"case {path}", problems)
    return case


def _resolve_case(path: Path, file: CaseFile, table: OwnTable | None) -> tuple[PomCase, list[str]]:
    """Return the case of a file and the problems of the file."""
    problems: list[str] = []
    own = find_own_table(path, file, table, problems)
    own_rows = own.rows if own is not None else ()
    check_case_names(file, own_rows, problems)
    files = _resolve_files(path, file, problems)
    facts, features = resolve_facts(file, files["aircraft"], problems)
    missing = facts.get("without", ())
    absent = tuple(name for name in file.case.absent if name not in missing)
    file = _with_facts(file, features, absent=(*absent, *missing))
    criteria = parts.resolve_criteria(file, problems, equipment=missing, own_rows=own_rows)
    check_table_names(file, criteria, problems)
    largest, fraction = parts.resolve_ranges(file.ranges, problems), parts.tolerance_fraction(file)
    drive = resolve_drive(file, criteria, problems)
    case = PomCase(
        **{key: getattr(file.case, key) for key in _AS_WRITTEN},
        **files,
        path=str(path),
        tolerances=os.path.normpath(own.path) if own is not None else "",
        table=table_excerpt(own, file),
        facts=facts,
        absent=absent,
        drive=drive,
        conditions=parts.resolve_conditions(file.conditions, problems),
        events=dict(file.events),
        criteria=parts.scale_tolerances(criteria, fraction, largest),
        fraction=fraction,
        wind=file.drive.wind,
        ranges=largest,
        certified=parts.certified_values(file.certified, problems),
        ticks=dict(file.ticks),
        rationale=dict(file.rationale),
        source=dict(file.source),
        compliance=dict(file.compliance),
        signatures=plain_signatures(file.signatures),
        law_moves=file.control_law.moves if file.control_law is not None else (),
    )
    return case, problems


def _with_facts(file: CaseFile, features: tuple[str, ...], *, absent: tuple[str, ...]) -> CaseFile:
    """Return a case file with the features and the missing equipment that follow from facts."""
    table = file.case.model_copy(update={"features": features, "absent": absent})
    return file.model_copy(update={"case": table})


def _resolve_files(path: Path, file: CaseFile, problems: list[str]) -> dict[str, Any]:
    """Return the fields of a case that are files, relative to the case file."""

    def resolve(name: str, key: str) -> str:
        return parts.resolve_named_file(path, name, key=key, problems=problems)

    files: dict[str, Any] = {}
    for key in ("record", "names", "aircraft"):
        files[key] = resolve(getattr(file.case, key), f"case.{key}")
    if file.control_law is not None:
        files["law"] = resolve(file.control_law.fmu, "control_law.fmu")
        files["law_names"] = resolve(file.control_law.names, "control_law.names")
    files["models"] = {
        model: resolve(table, f"models.{model}") for model, table in file.models.items()
    }
    return files


_AS_WRITTEN = (
    "id",
    "standard",
    "edition",
    "name",
    "title",
    "description",
    "window",
    "features",
    "additional",
    "shortened",
    "show",
    "reference",
    "objective",
    "procedure",
    "manual",
    "evaluation",
    "notes",
)
"""Keys of ``[case]`` that are fields of the case without a change."""
