"""Roles of the cases of listings in `from_datcom`, from their cards and headings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from aerodb.prior.clean_cases import (
    alphas_of,
    case_label,
    comparable_cards,
    describe_copy,
    describe_other_aircraft,
    require_one_aircraft,
)
from aerodb.prior.sources import warn_user
from datcom_io.arrays.conditions import control_surface
from datcom_io.decks.aircraft_rules import has_thrust
from datcom_io.decks.device_fit import (
    IS_FLAP,
    MAY_BE_FLAP,
    DeviceDoubt,
    advise_on_misfit,
    describe_misfit,
    states_elevator,
    weigh_device_on_tail,
)
from datcom_io.decks.namelists import COUNTS
from datcom_io.listing import Case

_PLAIN = 1  # FTYPE of SYMFLP
_SPOILERS, _AILERON, _DIFFERENTIAL_TAIL = (1, 2, 3), 4, 5  # STYPE of ASYFLP
# Roles in which the program carries results from condition to condition and from deflection to
# deflection.  Their shortest runs are the most accurate.
_DRIFTING = ("flaps", "elevator", "tabs", "aileron_hinge", "ground_flap")
_ASYMMETRIC_ROLES = ("aileron", "spoilers", "differential_tail")  # roles of the namelist ASYFLP
_ASYMMETRIC_PAGES = {
    "asyflp_roll",
    "asyflp_tail",
    "spoiler",
    "spoiler_slot",
    "spoiler_supersonic",
}


def _deflection_variables() -> tuple[str, ...]:
    """Return the variables of SYMFLP that depend on its deflections."""
    for name, _, needed, others in COUNTS:
        if name == "SYMFLP":
            return ("NDELTA", *needed, *others)
    raise LookupError("datcom_io.decks.namelists.COUNTS has no entry of SYMFLP")


_DEFLECTION_VARIABLES = _deflection_variables()


@dataclass(frozen=True)
class CaseRole:
    """Roles of a case, and the reason for them.

    Attributes
    ----------
    case : Case
    roles : tuple of str
        Roles in `from_datcom`; empty if the case is not used.
    reason : str
        The cards and headings that determine the roles.
    """

    case: Case
    roles: tuple[str, ...]
    reason: str


def assign_roles(given: Iterable[Any]) -> list[CaseRole]:
    """Return the roles of each case of some listings.

    Parameters
    ----------
    given : iterable of Listing or Case
        Results of `datcom_io.split_deck` and `datcom_io.run_deck`, or listings of several cases in
        any order.

    Returns
    -------
    list of CaseRole
        In the order of the cases.  The whole aeroplane is the configuration with the most
        components.  If several cases have the same conditions in one role, the first is used; with
        SYMFLP that of the shortest run.  A device beyond the tip of its surface, or with a larger
        chord, has no role.  Neither has a spoiler without height, nor the flap of a wing that the
        program computes on the tail: its FTYPE, the cards of another case, its name and
        deflections, or its stations and chords show it (`datcom_io.decks.device_fit`).  If every
        case of the whole aeroplane has a device, the static pages of these cases, those of the
        elevator first, are the clean ones: the program prints them without deflection.

    Raises
    ------
    SchemaError
        Cases of the whole aeroplane differ in their geometry: several aircraft.  The case of a
        device on another wing or tail than theirs has no role.
    """
    cases: list[Case] = []
    for item in given:
        cases += getattr(item, "cases", [item])
    aeroplane = max(map(_fullest_configuration, cases), key=_count_components, default="")
    # Span stations of the ailerons: a SYMFLP at the same stations gives their hinge moments.
    hinges = {_span_stations(case, "ASYFLP") for case in cases if _style(case) == _AILERON}
    wing_flaps = []
    for case in cases:
        if "SYMFLP" in case.deck.namelists and control_surface(case.deck) == "wing":
            wing_flaps.append(_device_cards(case, "SYMFLP"))
    assigned = []
    for case in cases:
        misfit = describe_misfit(case.deck) or _describe_wing_flap(case, wing_flaps)
        doubt = "; ".join(weigh_device(case).clauses) if _is_on_tail(case) else ""
        roles, reason = _find_roles(case, aeroplane, hinges)
        # Pages with power effects, and without a table of the device, do not contain it.
        if misfit and "power" not in roles:
            roles, reason = (), f"device not used: {misfit}; {advise_on_misfit(case.deck)}"
        elif doubt and "elevator" in roles:
            reason += f", doubtful: {doubt}"
        assigned.append(CaseRole(case, roles, reason))
    if not _cases_of_role(assigned, "clean"):
        assigned = _assign_clean(assigned, aeroplane)
    clean = [item.case for item in _cases_of_role(assigned, "clean")]
    require_one_aircraft(clean)
    if clean:
        assigned = [_without_other_aircraft(item, clean[0]) for item in assigned]
    # Roles in order of appearance, each once.
    present: dict[str, None] = {}
    for item in assigned:
        present.update(dict.fromkeys(item.roles))
    for role in present:
        assigned = _without_repetitions(assigned, role)
    return assigned


def by_role(found: Iterable[CaseRole]) -> dict[str, list[Case]]:
    """Return the cases of each role, as arguments of `from_datcom`."""
    roles: dict[str, list[Case]] = {}
    for item in found:
        for role in item.roles:
            roles.setdefault(role, []).append(item.case)
    return roles


def _describe_wing_flap(case: Case, wing_flaps: list[dict[str, Any]]) -> str:
    """Return why a SYMFLP that the program computes on the tail is the flap of the wing.

    It may fit inside the tail. Slots, Fowler flaps and slats are not elevators, the cards may be
    those of a flap on the wing, a device that moves down only and is named a flap is one, and its
    stations and chords may be those of the wing.
    """
    deck = case.deck
    if not _is_on_tail(case):
        return ""
    kind = round(deck.value("SYMFLP", "FTYPE") or 1.0)
    if kind != _PLAIN:
        return f"$SYMFLP: FTYPE={kind} is a high-lift device of a wing, an elevator has FTYPE=1"
    if _device_cards(case, "SYMFLP") in wing_flaps:
        return "the cards of SYMFLP are those of a case without horizontal tail"
    angles = deck.schedule("SYMFLP", "DELTA", "NDELTA")
    if _is_named_flap(case) and angles and min(angles) >= 0.0:
        return f"the case is named {case.name!r}, and all deflections point down"
    doubt = weigh_device(case)
    if doubt.weight >= IS_FLAP:
        return f"$SYMFLP: {'; '.join(doubt.clauses)}"
    return ""


def weigh_device(case: Case) -> DeviceDoubt:
    """Return the evidence that an elevator is the flap of the wing, by geometry and name.

    A case that is named an elevator, or trimmed with it, is one; the geometry gives a warning.
    """
    doubt = weigh_device_on_tail(case.deck)
    clauses, weight = doubt.clauses, doubt.weight
    if _is_named_flap(case):
        clauses, weight = (*clauses, f"the case is named {case.name!r}"), weight + 1
    if states_elevator(case.deck, case.name):
        weight = min(weight, MAY_BE_FLAP)
    return DeviceDoubt(weight, clauses)


def _is_on_tail(case: Case) -> bool:
    """Return whether a case has a SYMFLP that the program computes on the tail."""
    return "SYMFLP" in case.deck.namelists and control_surface(case.deck) == "tail"


def _is_named_flap(case: Case) -> bool:
    """Return whether a case is named a flap, and no elevator."""
    name = case.name.upper()
    return "FLAP" in name and "ELEV" not in name


def _cases_of_role(assigned: Iterable[CaseRole], role: str) -> list[CaseRole]:
    """Return the cases with a role."""
    return [item for item in assigned if role in item.roles]


def _without_other_aircraft(item: CaseRole, clean: Case) -> CaseRole:
    """Return a case without roles if its surfaces are not those of the clean aeroplane."""
    other = describe_other_aircraft(item.case.deck, clean.deck)
    if not item.roles or not other:
        return item
    reason = f"{item.reason}; not used: another aircraft than {case_label(clean)}, {other}"
    return replace(item, roles=(), reason=reason)


def _find_roles(
    case: Case, aeroplane: str, hinges: set[tuple[float | None, ...]]
) -> tuple[tuple[str, ...], str]:
    """Return the roles of a case by itself, and the reason."""
    # Names of the printed tables, over all pages of the case.
    printed: set[str] = set()
    has_ground_page, power = False, ""
    for page in case.pages:
        printed.update(item.name for item in page.printed)
        if page.ground_height != float("inf") and page.kind == "static":
            has_ground_page = True
        # Engines of zero thrust have no effect of power.
        if page.power != "off" and not power and has_thrust(case.deck):
            power = page.power
    configuration = _fullest_configuration(case)
    # Power and ground pages also have static tables, so that they are decided first.
    # The pages of a control device contain no power.
    if power and not printed & (_ASYMMETRIC_PAGES | {"symflp"}):
        namelist = {"jet": "JETPWR"}.get(power, "PROPWR")
        return ("power",), f"{namelist}: {configuration} with {power} power"
    if has_ground_page:
        return _find_ground_role(case, configuration, aeroplane)
    if printed & _ASYMMETRIC_PAGES:
        return _find_asymmetric_role(case)
    if "symflp" in printed:
        return _find_flap_roles(case, printed, hinges)
    if "static" not in printed:
        return (), "prints no table of coefficients"
    if configuration != aeroplane:
        return (), f"{configuration}: a part of {aeroplane}"
    if printed & {"trim_stabilizer", "trim_stabilizer_aircraft"}:
        return ("clean", "elevator"), f"{configuration}; TRIM with an all-movable stabilizer"
    return ("clean",), configuration


def _find_asymmetric_role(case: Case) -> tuple[tuple[str, ...], str]:
    """Return the role of a case with ASYFLP, which its STYPE determines."""
    style = _style(case)
    role = "aileron"
    if style in _SPOILERS:
        role = "spoilers"
    elif style == _DIFFERENTIAL_TAIL:
        role = "differential_tail"
    return (role,), f"ASYFLP with STYPE {style}"


def _find_ground_role(
    case: Case, configuration: str, aeroplane: str
) -> tuple[tuple[str, ...], str]:
    """Return the role of a case with GRNDEF."""
    if "SYMFLP" in case.deck.namelists:
        # With a flap on the wing only the first deflection of a run is right.
        surface = control_surface(case.deck)
        reason = f"GRNDEF with SYMFLP on the {surface}"
        if surface == "tail":
            return ("ground_elevator",), reason
        if surface == "wing" and (case.deck.count("SYMFLP", "NDELTA") or 0) > 1:
            return (
                (),
                f"{reason}: only the first of several deflections of a run is right; run one "
                f"at a time (datcom split)",
            )
        return ("ground_flap",), reason
    if configuration != aeroplane:
        return (), f"GRNDEF with {configuration}: a part of {aeroplane}"
    return ("ground",), f"GRNDEF: {configuration}"


def _find_flap_roles(
    case: Case, printed: set[str], hinges: set[tuple[float | None, ...]]
) -> tuple[tuple[str, ...], str]:
    """Return the roles of a case with SYMFLP."""
    if control_surface(case.deck) == "wing":
        if _span_stations(case, "SYMFLP") in hinges:
            return ("aileron_hinge",), "SYMFLP on the wing at the span stations of the aileron"
        return ("flaps",), "SYMFLP on the wing"
    if any(name.startswith("tab_") for name in printed):
        return ("elevator", "tabs"), "SYMFLP on the tail with CONTAB"
    return ("elevator",), "SYMFLP on the tail"


def _assign_clean(assigned: list[CaseRole], aeroplane: str) -> list[CaseRole]:
    """Use cases of the aeroplane with a device, or else with power, as the clean ones.

    The static pages of a device are those without deflection. An elevator comes first: the deck
    that has one is that of the whole aeroplane in its usual state.
    """
    for is_candidate, reason in (
        (lambda item: "elevator" in item.roles, "its static pages, without deflection"),
        (_has_device_only, "its static pages, without deflection"),
        (lambda item: "power" in item.roles, "no case without power"),
    ):
        changed, is_changed = [], False
        for item in assigned:
            if is_candidate(item) and _fullest_configuration(item.case) == aeroplane:
                item = _also_clean(item, reason)
                is_changed = True
            changed.append(item)
        if is_changed and aeroplane:
            return changed
    return assigned


def _has_device_only(item: CaseRole) -> bool:
    """Return whether a case has a device, and neither power nor ground effect."""
    names = item.case.deck.namelists.keys()
    return bool(names & {"SYMFLP", "ASYFLP"}) and not (
        "GRNDEF" in names or has_thrust(item.case.deck)
    )


def _also_clean(item: CaseRole, reason: str) -> CaseRole:
    """Return a case that is also clean; a powered one is clean only."""
    roles: tuple[str, ...] = ("clean",)
    if "power" not in item.roles:
        roles = ("clean", *item.roles)
    return replace(item, roles=roles, reason=f"{item.reason}; clean: {reason}")


def _without_repetitions(assigned: list[CaseRole], role: str) -> list[CaseRole]:
    """Remove a role from cases with repeated conditions, and from those of another device.

    The device is that of the first case, and of elevators of the one that fits the tail best.
    """
    candidates = _cases_of_role(assigned, role)
    if not candidates:
        return assigned
    device = "SYMFLP"
    if role in _ASYMMETRIC_ROLES:
        device = "ASYFLP"
    if role == "elevator":
        # Of several devices on the tail the one that fits it best is the elevator.
        candidates.sort(key=lambda item: weigh_device(item.case).weight)
    first = candidates[0].case
    cards = _device_cards(first, device)
    # Cases with most conditions come first, in drifting roles those with fewest.
    order = -1
    if role in _DRIFTING:
        order = 1
    candidates.sort(key=lambda item: len(_conditions(item.case, role)) * order)
    used: list[Case] = []
    reasons: dict[int, str] = {}
    for item in candidates:
        repeated = _first_overlap(item.case, used, role)
        if repeated is not None and role == "clean" and _has_other_angles(item.case, used):
            repeated = None
        if role != "clean" and _device_cards(item.case, device) != cards:
            reasons[id(item)] = f"another {device} than in {case_label(first)}"
        elif repeated is not None:
            reasons[id(item)] = f"conditions of {case_label(repeated)}"
            if text := describe_copy(item.case, repeated, role):
                warn_user(text)
        else:
            used.append(item.case)
    result = []
    for item in assigned:
        if id(item) in reasons:
            roles = tuple(name for name in item.roles if name != role)
            reason = f"{item.reason}; left out as {role}: {reasons[id(item)]}"
            item = replace(item, roles=roles, reason=reason)
        result.append(item)
    return result


def _first_overlap(case: Case, used: Iterable[Case], role: str) -> Case | None:
    """Return the first used case with a condition of another one, None without any."""
    for earlier in used:
        if _conditions(earlier, role) & _conditions(case, role):
            return earlier
    return None


def _has_other_angles(case: Case, used: Iterable[Case]) -> bool:
    """Return whether a case continues the used ones of its conditions in angle of attack."""
    known: set[float] = set()
    for earlier in used:
        shared = _conditions(earlier, "clean") & _conditions(case, "clean")
        if shared:
            if _conditions(earlier, "clean") != _conditions(case, "clean"):
                return False
            known |= alphas_of(earlier)
    return not alphas_of(case) <= known


def _device_cards(case: Case, device: str) -> dict[str, Any]:
    """Return the cards of a device without its deflections."""
    cards = {}
    for name, values in (comparable_cards(case).get(device) or {}).items():
        if device != "SYMFLP" or name not in _DEFLECTION_VARIABLES:
            cards[name] = values
    return cards


def _conditions(case: Case, role: str) -> set[tuple[float, float, float]]:
    """Return Mach number, altitude and deflection of all pages. [1, of the deck, deg]

    The deflection is that of symmetrical flaps, and 0 in roles without them.
    """
    deflections = [0.0]
    if role in _DRIFTING:
        deflections = case.deck.schedule("SYMFLP", "DELTA", "NDELTA") or deflections
    conditions = set()
    for page in case.pages:
        if page.conditions is None or not page.printed:
            continue
        for deflection in deflections:
            conditions.add((page.condition("mach"), page.condition("h"), deflection))
    return conditions


def _fullest_configuration(case: Case) -> str:
    """Return the configuration of the static pages with the most components."""
    configurations = [page.configuration for page in case.pages if page.kind == "static"]
    return max(configurations, key=_count_components, default="")


def _count_components(configuration: str) -> int:
    """Return the number of components of a configuration such as ``WING-BODY``."""
    if not configuration:
        return 0
    return len(configuration.split("-"))


def _style(case: Case) -> int:
    """Return the STYPE of ASYFLP, 0 without it."""
    return round(case.deck.value("ASYFLP", "STYPE") or 0.0)


def _span_stations(case: Case, namelist: str) -> tuple[float | None, ...]:
    """Return the inner and outer span station of a flap. [of the deck]"""
    return case.deck.value(namelist, "SPANFI"), case.deck.value(namelist, "SPANFO")
