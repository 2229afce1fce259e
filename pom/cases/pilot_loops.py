"""Loops of the math pilot of a case: the controls they move, the channels they hold."""

from __future__ import annotations

from collections.abc import Sequence

from flightmech.errors import UnknownName
from flightmech.names import lookup
from pom.cases.case_file import BRAKES, FORCES, SURFACES, TRAVEL, CaseFile, LoopTable
from pom.cases.pilot import PilotLoop
from pom.cases.resolve import collect_case_problems, resolve_quantities
from pom.tolerances.criteria import Criterion
from pom.tolerances.rows import required_signals

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
