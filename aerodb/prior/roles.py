"""Which role the cases of listings play in `from_datcom`, from their own cards and headings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from datcom_io.arrays.conditions import control_surface
from datcom_io.decks.namelists import COUNTS
from datcom_io.listing import Case
from flightmech.errors import SchemaError

_SPOILERS, _AILERON, _DIFFERENTIAL_TAIL = (1, 2, 3), 4, 5
# what the program carries from condition to condition and from deflection to deflection: short runs
# are the better ones
_DRIFTING = ("flaps", "elevator", "tabs", "aileron_hinge", "ground_flap")
_OF_THE_DEFLECTION = (
    "NDELTA",
    *next(needed + others for name, _, needed, others in COUNTS if name == "SYMFLP"),
)
_OF_THE_RUN = ("FLTCON", "GRNDEF")  # namelists that do not make another aircraft or device


@dataclass(frozen=True)
class CaseRole:
    """What a case was taken for.

    Attributes
    ----------
    case : Case
    roles : tuple of str
        Roles in `from_datcom`; empty when the case is left out.
    reason : str
        The cards and headings that decided it.
    """

    case: Case
    roles: tuple[str, ...]
    reason: str


def assign_roles(given: Iterable[Any]) -> list[CaseRole]:
    """Return what each case of some listings is taken for.

    Parameters
    ----------
    given : iterable of Listing or Case
        What `datcom_io.split_deck` and `datcom_io.run_deck` left, or listings of several cases in
        any order.

    Returns
    -------
    list of Assignment
        In the order given.  The whole aeroplane is the configuration with the most components.  Of
        cases that give the same conditions in one role the first is taken, with SYMFLP that of the
        shortest run.  Where every case of the whole aeroplane has a deflection, the static pages of
        the elevator cases are the clean ones: the program prints them without deflection.

    Raises
    ------
    SchemaError
        Cases of the whole aeroplane differ in their geometry: several aircraft.
    """
    cases = [case for item in given for case in (item if hasattr(item, "cases") else [item])]
    whole = max((_configuration(case) for case in cases), key=_components, default="")
    hinges = {_stations(case, "ASYFLP") for case in cases if _style(case) == _AILERON}
    found = [CaseRole(case, *_role(case, whole, hinges)) for case in cases]
    if not any("clean" in item.roles for item in found):
        found = _clean_among_others(found, whole)
    _require_one_aircraft([item.case for item in found if "clean" in item.roles])
    for role in dict.fromkeys(role for item in found for role in item.roles):
        found = _without_repetitions(found, role)
    return found


def by_role(found: Iterable[CaseRole]) -> dict[str, list[Case]]:
    """Return the cases of each role, as `from_datcom` takes them."""
    roles: dict[str, list[Case]] = {}
    for item in found:
        for role in item.roles:
            roles.setdefault(role, []).append(item.case)
    return roles


def _role(
    case: Case, whole: str, hinges: set[tuple[float | None, ...]]
) -> tuple[tuple[str, ...], str]:
    """Return the roles of a case by itself, and why."""
    printed = {item.name for page in case.pages for item in page.printed}
    configuration = _configuration(case)
    power = next((page.power for page in case.pages if page.power != "off"), "")
    if power:
        return (
            "power",
        ), f"{'JETPWR' if power == 'jet' else 'PROPWR'}: {configuration} with {power} power"
    if any(page.ground_height != float("inf") and page.kind == "static" for page in case.pages):
        return _ground_role(case, configuration, whole)
    if printed & {"asyflp_roll", "asyflp_tail", "spoiler", "spoiler_slot", "spoiler_supersonic"}:
        style = _style(case)
        role = (
            "spoilers"
            if style in _SPOILERS
            else "differential_tail"
            if style == _DIFFERENTIAL_TAIL
            else "aileron"
        )
        return (role,), f"ASYFLP with STYPE {style}"
    if "symflp" in printed:
        return _flap_roles(case, printed, hinges)
    if "static" not in printed:
        return (), "prints no table of coefficients"
    if configuration != whole:
        return (), f"{configuration}: a part of {whole}"
    movable = printed & {"trim_stabilizer", "trim_stabilizer_aircraft"}
    return (
        (("clean", "elevator"), f"{configuration}; TRIM with an all-movable stabilizer")
        if movable
        else (("clean",), configuration)
    )


def _ground_role(case: Case, configuration: str, whole: str) -> tuple[tuple[str, ...], str]:
    if "SYMFLP" in case.deck.namelists:
        surface = control_surface(case.deck)
        reason = f"GRNDEF with SYMFLP on the {surface}"
        if surface == "wing" and (case.deck.count("SYMFLP", "NDELTA") or 0) > 1:
            return (
                (),
                f"{reason}: only the first of several deflections of a run is right; run one "
                f"at a time (datcom split)",
            )
        return ("ground_elevator" if surface == "tail" else "ground_flap",), reason
    if configuration != whole:
        return (), f"GRNDEF with {configuration}: a part of {whole}"
    return ("ground",), f"GRNDEF: {configuration}"


def _flap_roles(
    case: Case, printed: set[str], hinges: set[tuple[float | None, ...]]
) -> tuple[tuple[str, ...], str]:
    if control_surface(case.deck) == "wing":
        if _stations(case, "SYMFLP") in hinges:
            return ("aileron_hinge",), "SYMFLP on the wing at the span stations of the aileron"
        return ("flaps",), "SYMFLP on the wing"
    tabs = any(name.startswith("tab_") for name in printed)
    return (
        (("elevator", "tabs"), "SYMFLP on the tail with CONTAB")
        if tabs
        else (("elevator",), "SYMFLP on the tail")
    )


def _clean_among_others(found: list[CaseRole], whole: str) -> list[CaseRole]:
    """Take the static pages of elevator cases, or the powered pages, for the clean ones."""
    for role, why in (
        ("elevator", "its static pages, without deflection"),
        ("power", "no case without power"),
    ):
        usable = [
            item for item in found if role in item.roles and _configuration(item.case) == whole
        ]
        if usable:
            return [_also_clean(item, role, why) if item in usable else item for item in found]
    return found


def _also_clean(item: CaseRole, role: str, why: str) -> CaseRole:
    roles = ("clean", *item.roles) if role == "elevator" else ("clean",)
    return replace(item, roles=roles, reason=f"{item.reason}; clean: {why}")


def _require_one_aircraft(clean: list[Case]) -> None:
    for case in clean[1:]:
        different = [name for name, one, other in _geometries(clean[0], case) if one != other]
        if different:
            raise SchemaError(
                "clean",
                [
                    f"several aircraft: {_words(clean[0])} {clean[0].name!r} and "
                    f"{_words(case)} {case.name!r} differ in "
                    f"{', '.join(different)}; give one with --clean FILE:CASE, or listings "
                    f"of one aircraft only"
                ],
            )


def _geometries(one: Case, other: Case) -> Iterator[tuple[str, object, object]]:
    first, second = _meaning(one), _meaning(other)
    for name in dict.fromkeys([*first, *second]):
        if name not in (*_OF_THE_RUN, "SYMFLP", "CONTAB", "JETPWR", "PROPWR"):
            yield name, first.get(name), second.get(name)


def _without_repetitions(found: list[CaseRole], role: str) -> list[CaseRole]:
    """Leave out cases whose conditions another case of the role gives, and other devices than the
    first one.
    """
    inside = [item for item in found if role in item.roles]
    device = {"aileron": "ASYFLP", "spoilers": "ASYFLP", "differential_tail": "ASYFLP"}.get(
        role, "SYMFLP"
    )
    first = _shape(inside[0].case, device) if inside else None
    taken: list[CaseRole] = []
    left: dict[int, str] = {}
    for item in sorted(
        inside, key=lambda item: len(_places(item.case, role)) * (1 if role in _DRIFTING else -1)
    ):
        same = next(
            (other for other in taken if _places(other.case, role) & _places(item.case, role)), None
        )
        if role != "clean" and _shape(item.case, device) != first:
            left[id(item)] = (
                f"left out as {role}: another {device} than in {_words(inside[0].case)}"
            )
        elif same is not None:
            left[id(item)] = f"left out as {role}: conditions of {_words(same.case)}"
        else:
            taken.append(item)
    return [
        replace(
            item,
            roles=tuple(other for other in item.roles if other != role),
            reason=f"{item.reason}; {left[id(item)]}",
        )
        if id(item) in left
        else item
        for item in found
    ]


def _words(case: Case) -> str:
    return f"{case.file}:{case.ordinal}"


def _meaning(case: Case) -> dict[str, Any]:
    """Return the namelists of a case and its airfoil sections, comparable."""
    meaning = case.deck.meaning()
    namelists: Any = meaning["namelists"]
    return {**namelists, "NACA": meaning["sections"]}


def _shape(case: Case, device: str) -> dict[str, Any]:
    """Return the cards of a device without its deflections."""
    group = _meaning(case).get(device) or {}
    return {
        name: values
        for name, values in group.items()
        if device != "SYMFLP" or name not in _OF_THE_DEFLECTION
    }


def _places(case: Case, role: str) -> set[tuple[float, float, float]]:
    """Return Mach numbers and altitudes of the pages, as printed, and the deflections of
    symmetrical flaps. [1, of the deck, deg]
    """
    pages = [page for page in case.pages if page.conditions is not None and page.printed]
    deflections = case.deck.schedule("SYMFLP", "DELTA", "NDELTA") if role in _DRIFTING else []
    return {
        (page.condition("mach"), page.condition("h"), delta)
        for page in pages
        for delta in deflections or [0.0]
    }


def _configuration(case: Case) -> str:
    """Return the configuration of the static pages with the most components."""
    return max(
        (page.configuration for page in case.pages if page.kind == "static"),
        key=_components,
        default="",
    )


def _components(configuration: str) -> int:
    return len(configuration.split("-")) if configuration else 0


def _style(case: Case) -> int:
    return round(case.deck.value("ASYFLP", "STYPE") or 0.0)


def _stations(case: Case, namelist: str) -> tuple[float | None, ...]:
    return case.deck.value(namelist, "SPANFI"), case.deck.value(namelist, "SPANFO")
