"""A Proof-of-Match case: one row of the tolerance table, one window of one flight record, and how
the model is driven.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from flightmech.errors import SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.support.input_files import read_toml
from flightmech.support.toml_models import validate_content
from pom.cases import resolve as parts
from pom.cases.case_file import FORCES, INPUTS, SHOWN, TRAVEL, WIND, CaseFile, plain_signatures
from pom.cases.pilot import PilotLoop
from pom.tolerances import rows
from pom.tolerances.criteria import Criterion

PRIMARY = {"recorded": ("delta_e", "delta_a", "delta_r"), "cockpit": TRAVEL, "force": FORCES}
"""Level of drive: the recorded controls that drive pitch, roll and yaw."""

_POWER = {"thrust": ("thrust",), "n1": ("n1",), "throttle": ("throttle", "pla")}
"""What a drive of the engines sets: the angle of a lever is its position."""


@dataclass(frozen=True)
class CaseInputs:
    """How the model is driven.

    Attributes
    ----------
    surfaces : str
        ``recorded``: recorded surface positions; ``cockpit``: recorded travel of column, wheel and
        pedals; ``force``: recorded pilot forces; ``pilot``: the recorded controls plus what the
        loops of the math pilot add.
    engine : str
        ``thrust``: recorded thrust drives; ``n1``: the recorded fan speed; ``throttle``: the
        recorded lever drives the engine model.
    trim : bool or "ground"
        Trim the model to the flight condition at the start of the window; its biases are reported.
        ``ground``: it stands or rolls on its wheels, whose height and attitude are solved for; the
        surfaces stay as recorded.
    limits : dict of str to float
        Largest biases of the trim, and largest accelerations it leaves, as the case file limits
        them: ``delta_e``, ``thrust``, ``F_column``, ``u_dot`` ...; a run beyond one is invalid.
        [SI]
    held_by : {"force", "friction"}
        What holds the controls at the start of a run with recorded forces: the recorded force and a
        bias; or dry friction as far as it can, and a bias beyond.
    pilot : tuple of Loop
        Loops of the math pilot; only with ``surfaces = "pilot"``.
    trim_surfaces : tuple of str
        Trim surfaces that the trim solves for, so that the recorded forces hold the controls at the
        start.
    runway : str
        ``dry``, ``wet``, ``icy``; empty for the state in the aircraft file.
    """

    surfaces: str = "recorded"
    engine: str = "thrust"
    trim: bool | str = True
    limits: dict[str, float] = field(default_factory=dict)
    pilot: tuple[PilotLoop, ...] = ()
    held_by: str = "force"
    trim_surfaces: tuple[str, ...] = ()
    runway: str = ""

    @property
    def level(self) -> str:
        """What pitch, roll and yaw are driven by: a key of `PRIMARY`; with a math pilot that of the
        controls he moves.
        """
        if self.surfaces != "pilot":
            return self.surfaces
        return next(
            (level for loop in self.pilot if (level := parts.drive_level(loop.control))), "recorded"
        )

    @classmethod
    def from_dict(cls, item: Mapping[str, Any]) -> CaseInputs:
        """Rebuild a drive from ``dataclasses.asdict``."""
        loops = tuple(PilotLoop(**loop) for loop in item.get("pilot", ()))
        return cls(
            **{**item, "pilot": loops, "trim_surfaces": tuple(item.get("trim_surfaces", ()))}
        )


@dataclass(frozen=True)
class PomCase:
    """A case, resolved: defaults filled in, criteria looked up, windows in seconds of the record's
    clock.

    Attributes
    ----------
    name, title, description : str
    id, standard, edition : str
        Test, standard and edition of the tolerance table.
    path, record, names, aircraft : str
        The case file, the flight record, its name map and the aircraft file.
    window : tuple of float
        Start and end of the replay. [s]
    drive : Drive
    conditions : dict of str to float
        Contradictions between case file and record. [SI]
    events : dict of str to float
        Marked instants that bound windows: ``input_end``, ``change_start`` ... [s]
    features : tuple of str
        Conditions of table rows that hold, e.g. ``reversible_controls``.
    shortened : str
        Why a window is shorter than the table asks; empty when none is.
    show : tuple of str
        Channels to show in addition to the judged ones.
    criteria : tuple of Criterion
    reference : str
        ``flight``; ``engineering``: data of an engineering simulator; ``footprint``: a recording
        without a reference, which has no band and no verdict.
    fraction : float
        Share of the tolerance that is applied. [1]
    wind : str
        ``record``: the wind of the reconstruction; ``measured``: that of the raw record; ``none``:
        calm air.
    ranges : dict of str to float
        Largest value in service by channel, the base of lone percentages (``range_max``, rule R3).
        [SI]
    certified : dict of str to float
        Certified values below which a criterion fails inside its band, by parameter (climb
        gradients of 1.c.2, 1.c.4). [SI]
    ticks : dict of str to str
        By advisory criterion: name, date and words of the engineer who ticked it.
    rationale : dict of str to str
        By criterion or channel: why it is as it is.
    source : dict of str to str
        Where the flight data come from: document, pages, flight, run, filters ...
    signatures : dict of str to dict
        Who signs the pages of the case, by role: ``name``, ``date``, ``organisation``.
    models : dict of str to str
        By model: the table of its names, when its names, units or signs are not the canonical ones.
    law, law_names : str
        FMU of the control law and the table of its names; empty for none.
    law_moves : tuple of str
        Controls that the control law moves, in place of the record.
    objective, procedure, manual, evaluation, notes : str
        What the test shows, how it is flown automatically and by hand, how it is evaluated,
        remarks.
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
    drive: CaseInputs = CaseInputs()
    conditions: dict[str, float] = field(default_factory=dict)
    events: dict[str, float] = field(default_factory=dict)
    features: tuple[str, ...] = ()
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
        """Return the case file and the files it names."""
        return [
            name
            for name in (
                self.path,
                self.record,
                self.names,
                self.aircraft,
                *self.models.values(),
                self.law,
                self.law_names,
            )
            if name
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return the case as plain data."""
        return asdict(self)

    @classmethod
    def from_dict(cls, item: Mapping[str, Any]) -> PomCase:
        """Rebuild a case from `to_dict`."""
        return cls(
            **{
                **item,
                "window": (item["window"][0], item["window"][1]),
                "drive": CaseInputs.from_dict(item["drive"]),
                "features": tuple(item["features"]),
                "show": tuple(item["show"]),
                "law_moves": tuple(item.get("law_moves", ())),
                "criteria": tuple(Criterion.from_dict(c) for c in item["criteria"]),
            }
        )


def driven_quantities(case: PomCase) -> set[str]:
    """Return the quantities that the record sets, so that they cannot be judged; what math pilot or
    control law move is not among them.
    """
    names = set(INPUTS).difference(*PRIMARY.values()).union(PRIMARY[case.drive.level])
    moved = {loop.control for loop in case.drive.pilot}.union(case.law_moves)
    if "throttle" not in moved:
        names |= {f"engine{n}.{name}" for n in range(1, 9) for name in _POWER[case.drive.engine]}
    return names - moved


def read_case(path: str | Path) -> PomCase:
    """Read a case file and resolve it against the tolerance table.

    Parameters
    ----------
    path : str or Path
        TOML file; `docs/explanation/proof-of-match/cases.md` describes it.  Files it names are relative to it.

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
        rest = parts.sound_rest(content)
        more = _resolved(path, rest)[1] if rest is not None else _loose_problems(content)
        raise SchemaError(
            error.what, [*error.problems, *(text for text in more if text not in error.problems)]
        ) from None
    case, problems = _resolved(path, file)
    if problems:
        raise SchemaError(f"case {path}", problems)
    return case


def _resolved(path: Path, file: CaseFile) -> tuple[PomCase, list[str]]:
    """Return the case of a file, and what is wrong with it."""
    problems: list[str] = []
    case = file.case
    parts.check_events(file.events, problems)
    for name in case.show:
        parts.collect_case_problems(problems, "case.show", lookup, name)
    for word in case.features:
        if word not in rows.claimable_features():
            problems.append(
                f"case.features: {UnknownName(word, rows.claimable_features(), 'condition')}"
            )
    found = parts.resolve_criteria(file, problems)
    names = {c.name for c in found}
    parts.check_names("ticks", file.ticks, names, "criterion", problems)
    trim = {f"trim.{name}" for name in parts.LIMIT_UNITS}
    explained = names | {c.channel for c in found} | set(case.show) | trim
    parts.check_names(
        "rationale", file.rationale, explained, "criterion, channel or trim quantity", problems
    )
    parts.check_names(
        "certified", file.certified, {c.parameter for c in found}, "parameter", problems
    )
    calm = [name for name in file.conditions if name in WIND and file.drive.wind == "none"]
    problems += [
        f'conditions.{name}: drive.wind is "none", calm air; give one of the two' for name in calm
    ]
    largest, fraction = parts.resolve_ranges(file.ranges, problems), parts.tolerance_fraction(file)
    drive = _drive(file, found, problems)
    as_written: dict[str, Any] = {key: getattr(case, key) for key in _AS_WRITTEN}
    as_written |= {
        key: parts.resolve_named_file(path, getattr(case, key), f"case.{key}", problems)
        for key in ("record", "names", "aircraft")
    }
    law = file.control_law
    if law is not None and file.drive.surfaces != "recorded":
        problems.append(
            f"control_law: it drives surfaces, and drive.surfaces is "
            f'"{file.drive.surfaces}"; make it "recorded"'
        )
    resolved = PomCase(
        **as_written,
        path=str(path),
        drive=drive,
        conditions=parts.resolve_conditions(file.conditions, problems),
        events=dict(file.events),
        criteria=parts.scale_tolerances(found, fraction, largest),
        fraction=fraction,
        wind=file.drive.wind,
        ranges=largest,
        certified=parts.certified_values(file.certified, problems),
        ticks=dict(file.ticks),
        rationale=dict(file.rationale),
        source=dict(file.source),
        signatures=plain_signatures(file.signatures),
        law=parts.resolve_named_file(path, law.fmu, "control_law.fmu", problems)
        if law is not None
        else "",
        law_names=parts.resolve_named_file(path, law.names, "control_law.names", problems)
        if law is not None
        else "",
        law_moves=law.moves if law is not None else (),
        models={
            name: parts.resolve_named_file(path, place, f"models.{name}", problems)
            for name, place in file.models.items()
        },
    )
    return resolved, problems


_AS_WRITTEN = (
    *(
        "id",
        "standard",
        "edition",
        "name",
        "title",
        "description",
        "window",
        "features",
        "shortened",
        "show",
        "reference",
    ),
    *("objective", "procedure", "manual", "evaluation", "notes"),
)


def _drive(file: CaseFile, found: list[Criterion], problems: list[str]) -> CaseInputs:
    loops = parts.resolve_pilot_loops(file, problems)
    if file.case.reference != "footprint":
        parts.forbid_judged(loops, found, problems)
    given = file.drive
    if any(loop.control == "throttle" for loop in loops) and given.engine != "throttle":
        problems.append(
            f'drive.pilot: a loop moves the throttle, but drive.engine is "{given.engine}"; '
            f'drive the engines by "throttle"'
        )
    limits = parts.resolve_trim_limits(given.limits, problems)
    drive = CaseInputs(
        given.surfaces,
        given.engine,
        given.trim,
        limits,
        loops,
        given.held_by,
        given.trim_surfaces,
        given.runway,
    )
    if drive.trim_surfaces and (
        drive.level != "force" or drive.trim is not True or drive.held_by != "force"
    ):
        problems.append(
            "drive.trim_surfaces: a trim surface is solved for where recorded forces hold "
            "the controls at the start; "
            'give surfaces = "force", trim = true and held_by = "force", or leave it out'
        )
    if drive.held_by == "friction" and drive.level != "force":
        problems.append(
            f'drive.held_by: "friction" holds controls that forces drive; drive.surfaces is '
            f'"{given.surfaces}", make it "force"'
        )
    return drive


def _loose_problems(content: dict[str, Any]) -> list[str]:
    """Return what is known about the free tables of a file whose form is wrong elsewhere."""
    problems: list[str] = []
    conditions, events = content.get("conditions"), content.get("events")
    if isinstance(conditions, dict):
        parts.resolve_conditions(conditions, problems)
    if isinstance(events, dict):
        parts.check_events(events, problems)
    return problems
