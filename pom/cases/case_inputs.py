"""Drive of a case: the recorded quantities that move the model, and the loops of the math pilot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from flightmech.errors import UnknownName
from flightmech.names import lookup
from pom.cases.case_file import BRAKES, FORCES, SURFACES, TRAVEL, CaseFile, LoopTable
from pom.cases.pilot import PilotLoop
from pom.cases.resolve import collect_case_problems, resolve_quantities, resolve_trim_limits
from pom.tolerances.criteria import Criterion
from pom.tolerances.rows import required_signals

PRIMARY = {"recorded": ("delta_e", "delta_a", "delta_r"), "cockpit": TRAVEL, "force": FORCES}
"""By level of drive: the recorded controls that drive pitch, roll and yaw."""

MOVABLE = (*SURFACES, *TRAVEL, *FORCES, "throttle", "speedbrake", "delta_nw", *BRAKES)
"""Controls that a loop of the math pilot may move; ``throttle`` stands for all levers."""


KINDRED = (
    {"V", "V_cas", "V_eas", "V_ground", "mach", "qbar", "u", "distance"},
    {"theta", "q", "q_dot"},
    {"phi", "p", "p_dot"},
    {"psi", "r", "r_dot", "psi_dot", "y_runway"},
    {"h", "h_agl", "h_baro", "hdot", "gamma"},
    {"alpha", "w", "alpha_dot"},
    {"beta", "v", "beta_dot", "ay"},
    {"nz", "az", "dnz"},
)
"""Groups of channels that differ by an integral or a derivative: holding one holds the others."""


@dataclass(frozen=True)
class CaseInputs:
    """Drive of the model.

    Attributes
    ----------
    surfaces : str
        ``recorded``: recorded surface positions; ``cockpit``: recorded travel of column, wheel and
        pedals; ``force``: recorded pilot forces; ``pilot``: the recorded controls plus what the
        loops of the math pilot add.
    engine : str
        ``thrust``: recorded thrust drives; ``n1``: the recorded fan speed; ``throttle``: the
        recorded lever drives the engine model (``lever`` of a case file); ``torque``: that of the
        propeller shaft; ``map``: the manifold pressure; ``rpm``: the speed of the propeller, which
        a governor holds at the power of the lever.
    propeller : str
        What the governor holds when ``torque`` or ``map`` drives: ``lever``, the speed of the
        recorded propeller lever, or ``rpm``, the recorded speed.
    trim : bool or "ground"
        Trim the model to the flight condition at the start of the window; its biases are reported.
        ``ground``: the model stands or rolls on its wheels.  The trim solves for height and
        attitude, and the surfaces stay as recorded.
    limits : dict of str to float
        Limits of the case file for the biases of the trim and for its residual accelerations:
        ``delta_e``, ``thrust``, ``F_column``, ``u_dot`` ...  A run beyond one is invalid. [SI]
    pilot : tuple of PilotLoop
        Loops of the math pilot; only with ``surfaces = "pilot"``.
    held_by : {"force", "friction"}
        Balance of the controls at the start of a run with recorded forces.  ``force``: the recorded
        force and a bias.  ``friction``: dry friction up to its limit, then a bias.
    trim_surfaces : tuple of str
        Trim surfaces that the trim solves for, so that the recorded forces hold the controls at the
        start.
    runway : str
        ``dry``, ``wet``, ``icy``; empty for the state in the aircraft file.
    """

    surfaces: str = "recorded"
    engine: str = "thrust"
    propeller: str = "lever"
    trim: bool | str = True
    limits: dict[str, float] = field(default_factory=dict)
    pilot: tuple[PilotLoop, ...] = ()
    held_by: str = "force"
    trim_surfaces: tuple[str, ...] = ()
    runway: str = ""

    @property
    def level(self) -> str:
        """Level of drive of pitch, roll and yaw, a key of `PRIMARY`.

        With a math pilot it is the level of the controls that the pilot moves.
        """
        if self.surfaces != "pilot":
            return self.surfaces
        # `resolve_pilot_loops` allows the controls of one level only
        for loop in self.pilot:
            level = drive_level(loop.control)
            if level:
                return level
        return "recorded"

    @classmethod
    def from_dict(cls, item: Mapping[str, Any]) -> CaseInputs:
        """Rebuild a drive from ``dataclasses.asdict``."""
        # an older report has neither loops nor trim surfaces
        fields = dict(item)
        fields["pilot"] = tuple(PilotLoop(**loop) for loop in item.get("pilot", ()))
        fields["trim_surfaces"] = tuple(item.get("trim_surfaces", ()))
        return cls(**fields)


def resolve_pilot_loops(file: CaseFile, problems: list[str]) -> tuple[PilotLoop, ...]:
    """Return the loops of the math pilot in SI."""
    tables = file.drive.pilot
    if bool(tables) != (file.drive.surfaces == "pilot"):
        problems.append('drive.pilot: loops and surfaces = "pilot" go together; give both, or none')
    loops = []
    for i, item in enumerate(tables):
        loop = _resolve_loop(item, f"drive.pilot.{i}", problems)
        if loop is not None:
            loops.append(loop)
    # controls that belong to every level have an empty level
    levels = {drive_level(item.control) for item in tables} - {""}
    if len(levels) > 1:
        problems.append(
            f"drive.pilot: the loops move controls of {len(levels)} levels "
            f"({', '.join(sorted(levels))}); one level drives a model"
        )
    return tuple(loops)


_DRIVE_LEVELS = (
    dict.fromkeys(("delta_e", "delta_a", "delta_r"), "recorded")
    | dict.fromkeys(TRAVEL, "cockpit")
    | dict.fromkeys(FORCES, "force")
)


def drive_level(control: str) -> str:
    """Return the level of drive of a control; empty for a control of every level."""
    return _DRIVE_LEVELS.get(control, "")


def _resolve_loop(item: LoopTable, key: str, problems: list[str]) -> PilotLoop | None:
    if item.control not in MOVABLE:
        problems.append(f"{key}.control: {UnknownName(item.control, MOVABLE, 'control')}")
        return None
    channel = collect_case_problems(problems, f"{key}.channel", lookup, item.channel)
    if channel is None:
        return None
    # gain: control per error; integral: control per error and second
    control_unit, error_unit = lookup(item.control).units, channel.units
    units = {
        "gain": f"{control_unit}/{error_unit}",
        "integral": f"{control_unit}/{error_unit} s",
        "limit": control_unit,
    }
    texts = {name: getattr(item, name) for name in units}
    earlier = len(problems)
    values = resolve_quantities(key, texts, units=units, what="key", problems=problems)
    if values.get("limit", 1.0) <= 0.0:
        problems.append(
            f"{key}.limit: {values['limit']:g} is not positive; a limit is the largest correction"
        )
    if len(problems) > earlier:
        return None
    return PilotLoop(item.control, item.channel, **values)


def forbid_judged(
    loops: Sequence[PilotLoop], criteria: Sequence[Criterion], problems: list[str]
) -> None:
    """Report every loop on a judged channel, since a controller would pass any model.

    Source: qtg-report practice, section 5.
    """
    for loop in loops:
        # the channel itself and every channel that follows from it by integration
        kindred = {loop.channel}.union(*(group for group in KINDRED if loop.channel in group))
        judged = []
        for criterion in criteria:
            signals = required_signals(criterion)
            is_judged = criterion.applies and not criterion.reason
            if is_judged and kindred & set(signals):
                judged.append(f"{criterion.name} ({', '.join(signals)})")
        if judged:
            problems.append(
                f"drive.pilot: the loop of {loop.control} holds {loop.channel}, on which "
                f"{', '.join(judged)} is judged; a math pilot may not fly what is judged: hold "
                f"another channel, or drop the loop"
            )


def resolve_drive(file: CaseFile, criteria: Sequence[Criterion], problems: list[str]) -> CaseInputs:
    """Return the drive of a case in SI; its contradictions are added to `problems`."""
    table = file.drive
    engine = "throttle" if table.engine == "lever" else table.engine
    loops = resolve_pilot_loops(file, problems)
    # a footprint has no verdict, so a loop may hold any channel
    if file.case.reference != "footprint":
        forbid_judged(loops, criteria, problems)
    if any(loop.control == "throttle" for loop in loops) and engine != "throttle":
        problems.append(
            f'drive.pilot: a loop moves the throttle, but drive.engine is "{table.engine}"; '
            f'drive the engines by "throttle"'
        )
    if table.propeller == "rpm" and engine not in ("torque", "map"):
        problems.append(
            f'drive.propeller: "rpm" holds the recorded speed of a propeller that torque or '
            f'manifold pressure drives, but drive.engine is "{table.engine}"; write drive.engine = '
            f'"torque" or "map", or "rpm" for the recorded speed at the power of the lever'
        )
    drive = CaseInputs(
        surfaces=table.surfaces,
        engine=engine,
        propeller=table.propeller,
        trim=table.trim,
        limits=resolve_trim_limits(table.limits, problems),
        pilot=loops,
        held_by=table.held_by,
        trim_surfaces=table.trim_surfaces,
        runway=table.runway,
    )
    # Only recorded forces leave a surface free for the trim: the surface replaces the bias.
    is_held_by_force = drive.level == "force" and drive.trim is True and drive.held_by == "force"
    if drive.trim_surfaces and not is_held_by_force:
        problems.append(
            "drive.trim_surfaces: a trim surface is solved for where recorded forces hold the "
            'controls at the start; give surfaces = "force", trim = true and held_by = "force", '
            "or leave it out"
        )
    if drive.held_by == "friction" and drive.level != "force":
        problems.append(
            f'drive.held_by: "friction" holds controls that forces drive; drive.surfaces is '
            f'"{table.surfaces}", make it "force"'
        )
    return drive
