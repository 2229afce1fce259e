"""A-priori database of an aeroplane from listings of Digital DATCOM.

Assumptions: The aeroplane is symmetric.  Effects add up.  Increments printed for wing-body or at
one altitude hold for the whole aeroplane and every altitude.  A term without a DATCOM method is
absent and counts as zero (LR-743, section 3.1).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Required, TypedDict, Unpack

import xarray as xr

from aerodb.prior import control_devices as devices
from aerodb.prior import ground_increments, increments
from aerodb.prior.damping import with_tail_arm
from aerodb.prior.effect_to_terms import terms_of_effect
from aerodb.prior.power import power_effect, with_idle_engines, with_power_in_it
from aerodb.prior.print_remarks import (
    describe_suspect_numbers,
    describe_tail_pressure,
    list_missing_numbers,
)
from aerodb.prior.prior_errors import choose_errors, describe_uncalibrated
from aerodb.prior.reference_quantities import (
    Point,
    find_basic_ranges,
    find_reference_altitude,
    find_reference_point,
    refer_to_aircraft,
    warn_of_other_place,
)
from aerodb.prior.sources import Source, collect_source, split_powered, warn_user
from aerodb.store.effects import Effect
from aerodb.store.plausible_ranges import CANARD, REAR_WING, SUSPECT_NUMBERS, TAIL_PRESSURE
from aerodb.store.schema import make_prior_database
from aerodb.update.cautions.notices import note_plausibility, with_notices
from datcom_io.decks.aircraft_rules import ROUNDED_SPAN
from datcom_io.decks.check import describe_doubts
from datcom_io.decks.device_fit import advise_on_misfit, describe_misfit, weigh_device_on_tail
from datcom_io.decks.planforms import measure_main_wing, measure_wing
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError, UnknownName
from flightmech.quantities import value_in_si

_PARTS = ("WING-BODY", "WING ALONE", "DATCOM BODY ALONE", "BODY ALONE")
_ROLL_CONTROLS = {
    "aileron": increments.aileron_effect,
    "spoilers": devices.spoiler_effect,
    "differential_tail": devices.differential_tail,
}
# Roles whose increments are those of a control device.
_DEVICE_ROLES = (
    "flaps",
    "elevator",
    "aileron",
    "spoilers",
    "ground_flap",
    "ground_elevator",
    "aileron_hinge",
    "tabs",
)
_FLAP_OR_ELEVATOR = (
    "the program computed it on the horizontal tail: run the flap of a wing without HTPLNF; if it "
    "is an elevator, check its stations and chords, and give it its upward deflections"
)


class ListingsByRole(TypedDict, total=False):
    """Listings of DATCOM by their role: a Listing, Case, case tree, or list of them, or None."""

    clean: Required[Any]
    flaps: Any
    elevator: Any
    aileron: Any
    ground: Any
    ground_flap: Any
    ground_elevator: Any
    power: Any
    spoilers: Any
    differential_tail: Any
    tabs: Any
    aileron_hinge: Any


# In this order the roles are read, and stated in the history.
_ROLES = tuple(ListingsByRole.__annotations__)


def from_datcom(
    aircraft: Aircraft,
    *,
    altitude: float | str | None = None,
    powered: bool = False,
    tailless: bool = False,
    move_reference: bool = False,
    stderr: Mapping[str, tuple[float, float] | float] | None = None,
    errors: str = "guide",
    **listings: Unpack[ListingsByRole],
) -> xr.DataTree:
    """Return the a-priori database of Digital DATCOM listings.

    Parameters
    ----------
    aircraft : Aircraft
        Name, reference quantities and moment reference point of the coefficients.  Without a
        reference point that of the cards of `clean` is used (XCG, ZCG).
    clean : Listing, Case, case tree or list of them
        The whole aeroplane, static and dynamic (card DAMP) pages.  PART pages give the tail's share
        of missing alpha-dot derivatives.  Cases with JETPWR or PROPWR among others without them
        count as `power` unless that is given.
    flaps, elevator : as `clean`, optional
        SYMFLP on the wing, and on the tail.  With several conditions in one program run D(CM)
        drifts; give one run for each condition.  An all-movable stabilizer (TRIM without SYMFLP)
        can replace the elevator.  The elevator listing also gives its hinge moments.
    aileron : as `clean`, optional
        ASYFLP with ailerons (STYPE 4).
    ground : as `clean`, optional
        GRNDEF, whole aeroplane without deflection.
    ground_flap : as `clean`, optional
        GRNDEF with flap settings (wing-body), one deflection per program run, zero among them.
    ground_elevator : as `clean`, optional
        GRNDEF with elevator deflections, for which the program has no method: a warning, and no
        term.
    power : as `clean`, optional
        The whole aeroplane with JETPWR or PROPWR at Mach numbers and angles of attack of `clean`,
        with its input cards.
    spoilers, differential_tail : as `clean`, optional
        ASYFLP with STYPE 1 to 3, and with STYPE 5.
    tabs : as `clean`, optional
        CONTAB with SYMFLP on the tail.
    aileron_hinge : as `clean`, optional
        SYMFLP on the wing with the geometry of the aileron; only its hinge moments are used.
    altitude : float or str, optional
        Altitude of the basic tables, one of the printed ones; the default is the middle one. [m]
    powered : bool
        Permit pages with power only in `clean`.  The thrust force is subtracted according to the
        cards.  The effect of jet or slipstream on wing and tail remains in CL, CD and Cm, and their
        standard errors are increased by its size.
    tailless : bool
        Permit pages of a wing-body only in `clean`: the aircraft has no tail.
    move_reference : bool
        Permit a moment reference point of the aircraft more than 0.1 chord from the moment centre
        of a listing.
    stderr : mapping, optional
        A-priori relative and absolute standard errors by term, ``{"Cm/qhat": (0.5, 0.0)}``, and
        factors by regime and class of method, ``{"transonic static": 3.0}``.  They replace those of
        `aerodb.prior.prior_errors`.
    errors : {"guide", "calibrated"}
        Standard errors of the identification guide, or those of the calibration on aircraft with
        published derivatives.  With the latter the terms are multiplied by the calibrated ratios.

    Returns
    -------
    DataTree
        The database: forces in stability axes, moments and rates in body axes about the aircraft's
        reference point.  Root attribute ``absent`` lists the terms of the scheme without a source
        in DATCOM.

    Raises
    ------
    SchemaError
        A listing lacks the tables of its role, its conditions fill no grid, pages over ground are
        of several deflections of one run, a device lies more than 5 % of the semispan beyond the
        tip of its surface, the reference point lies off the plane of symmetry or more than 0.1
        chord from a moment centre, or the clean pages are powered or those of a wing-body, unless
        stated.
    UnknownName
        `stderr` names an unknown term, or a keyword is not a role of a listing.

    Warns
    -----
    AeromatchWarning
        The reference point is that of the cards, the clean listing has no dynamic page, powered
        pages are used, reference quantities differ by more than 1 % (coefficients are
        re-referenced), the planform cards give another ``x_ref_mac``, D(CM) comes from a loop over
        several conditions, ground pages with elevator are given, a value is extended into
        another speed regime, a spoiler of zero height has a moment, each Mach number has its
        own altitude, a term of a given listing is absent, a suspect number was replaced, the tail
        has an impossible dynamic pressure, or a value is implausible
        (`aerodb.store.plausibility`).
    """
    for role in listings:
        if role not in _ROLES:
            raise UnknownName(role, _ROLES, "role of a listing")
    sources = _collect_sources(listings, powered)
    clean_source = sources["clean"]
    # Speed regimes are those of the program's methods in the clean listing.
    prior = choose_errors(errors, "DATCOM", stderr, *clean_source.regimes)
    if not tailless:
        _require_tail(clean_source)
    if not clean_source.has("dynamic"):
        warn_user(
            f"clean: {clean_source.file} has no dynamic page, so that the database has no "
            f"damping (qhat, phat, rhat): "
            "run the deck with a card DAMP"
        )
    for remark in _list_doubts_of_decks(sources):
        warn_user(remark)
    if clean_source.powered:
        prior = with_power_in_it(prior, clean_source)
    if clean_source.idle:
        prior = with_idle_engines(prior, clean_source)
    reference = find_reference_point(aircraft, sources, move_reference)
    warn_of_other_place(aircraft, sources, reference)
    h_ref = find_reference_altitude(clean_source, value_in_si(altitude, "m", "altitude"))
    for remark in list_missing_numbers(clean_source, h_ref):
        warn_user(f"clean: {remark}")
    # All effects in the axes and with the reference of the program, then of the aircraft.
    program_effects = _collect_effects(sources, h_ref, b=aircraft.b, z_ref=reference[2])
    effects = refer_to_aircraft(program_effects, sources, aircraft, reference=reference)
    # Every table covers the range of the basic ones, so that a flight stays inside all tables.
    ranges = find_basic_ranges(effects["basic"].tables["CL"])
    leaves: dict[str, xr.Dataset] = {}
    for effect in (*effects.values(), *_hinge_effects(sources, h_ref)):
        leaves |= terms_of_effect(effect, prior, ranges)
    tree = _assemble_database(aircraft, leaves, reference=reference, sources=sources)
    # Nothing in the stored tables shows that the tail is absent, so the database states it.
    if pressure := describe_tail_pressure(clean_source, h_ref):
        tree.attrs = {**tree.attrs, TAIL_PRESSURE: pressure}
    if suspects := describe_suspect_numbers(clean_source, h_ref):
        tree.attrs = {**tree.attrs, SUSPECT_NUMBERS: suspects}
    if limit := describe_uncalibrated(prior, effects["basic"].tables["CL"]):
        warn_user(limit)
        tree.attrs = {**tree.attrs, **with_notices(tree.attrs, [limit])}
    tree, findings = note_plausibility(tree, aircraft)
    for finding in findings:
        if finding.kind in ("implausible", "unused"):
            warn_user(str(finding))
    return tree


def _collect_sources(listings: Mapping[str, Any], powered: bool) -> dict[str, Source]:
    """Return the sources of all roles that are given; powered cases of `clean` become `power`."""
    cases = {role: listing for role, listing in listings.items() if listing is not None}
    if "clean" not in cases:
        raise SchemaError(
            "clean", ["no listing of the whole aeroplane; give it with the keyword clean"]
        )
    if "power" not in cases:
        # Powered cases among unpowered ones are increments, not the clean aeroplane.
        without_power, with_power = split_powered(cases["clean"])
        if without_power and with_power:
            cases["clean"], cases["power"] = without_power, with_power
    elif powered:
        raise SchemaError(
            "power",
            [
                "powered pages are stated to be the clean ones (powered); leave out power, "
                "or state it no longer"
            ],
        )
    sources = {}
    for role in _ROLES:
        if role not in cases:
            continue
        use_power = role == "power"
        if role == "clean" and powered:
            use_power = not split_powered(cases[role])[0]
        sources[role] = collect_source(role, cases[role], use_power)
        if role in _DEVICE_ROLES:
            require_device_on_surface(sources[role])
    return sources


def require_device_on_surface(source: Source) -> None:
    """Raise if a device does not fit its surface; warn if it misses that by a little."""
    for deck in source.decks:
        if misfit := describe_misfit(deck):
            advice = advise_on_misfit(deck)
            raise SchemaError(source.role, [f"{source.file}: {misfit}; {advice}"])
    for misfit in dict.fromkeys(describe_misfit(deck, ROUNDED_SPAN) for deck in source.decks):
        if misfit:
            warn_user(f"{source.role}: {misfit}; it counts as a device of that surface")
    if source.role == "elevator":
        _warn_of_doubtful_elevator(source)


def _warn_of_doubtful_elevator(source: Source) -> None:
    """Warn if an elevator moves down only, or has stations of the flap of a wing."""
    deflections: set[float] = set()
    doubts: dict[str, None] = {}
    for deck in source.decks:
        deflections.update(deck.schedule("SYMFLP", "DELTA", "NDELTA"))
        doubts.update(dict.fromkeys(weigh_device_on_tail(deck).clauses))
    if len(deflections) > 1 and min(deflections) >= 0.0:
        degrees = " ".join(f"{delta:g}" for delta in sorted(deflections))
        doubts[f"all deflections of SYMFLP point down ({degrees} deg)"] = None
    if doubts:
        warn_user(
            f"{source.role}: {'; '.join(doubts)}, as those of the flap of a wing; it counts as the "
            f"elevator; {_FLAP_OR_ELEVATOR}"
        )


def _assemble_database(
    aircraft: Aircraft,
    leaves: Mapping[str, xr.Dataset],
    *,
    reference: Point,
    sources: Mapping[str, Source],
) -> xr.DataTree:
    """Return the database of all terms, in the order of the scheme."""
    origins = [f"{role} from {source.file}" for role, source in sources.items()]
    return make_prior_database(
        aircraft,
        leaves,
        reference,
        configuration=_describe_configuration(sources["clean"]),
        source="Digital DATCOM",
        references="AFFDL-TR-79-3032; LR-743",
        history=f"from_datcom: {'; '.join(origins)}",
        comment="moments and rates in body axes; DATCOM's stability-axis ones are turned by alpha "
        "at the nodes",
    )


def _list_doubts_of_decks(sources: Mapping[str, Source]) -> list[str]:
    """Return a clause for each number of the cards that no aeroplane has, once, after its role."""
    remarks: dict[str, str] = {}
    for role, source in sources.items():
        for deck in source.decks:
            for doubt in describe_doubts(deck):
                remarks.setdefault(doubt, f"{role}: {doubt}")
    return list(remarks.values())


def _describe_configuration(clean: Source) -> str:
    """Return the surfaces of the clean pages, with a mark of a surface ahead of the wing."""
    for deck in clean.decks:
        x_tail, x_wing = deck.value("SYNTHS", "XH"), deck.value("SYNTHS", "XW")
        if "HTPLNF" not in deck.namelists or x_tail is None or x_wing is None:
            continue
        if x_tail < x_wing:
            return f"{clean.configuration} {CANARD}"
        if measure_main_wing(deck) != measure_wing(deck):
            return f"{clean.configuration} {REAR_WING}"
    return clean.configuration


def _collect_effects(
    sources: Mapping[str, Source], h_ref: float, *, b: float, z_ref: float
) -> list[tuple[str, Effect]]:
    """Return all effects with the roles of their listings, in the axes of DATCOM."""
    clean = sources["clean"]
    # The clean aeroplane first: static, sideslip, pitch rates, lateral rates.
    clean_effects = increments.static_effects(clean, h_ref)
    clean_effects.append(increments.sideslip_effect(clean, h_ref))
    clean_effects += increments.pitch_rates(clean, h_ref)
    if clean.has("dynamic"):
        clean_effects += increments.lateral_rates(clean, h_ref)
    effects = [("clean", effect) for effect in clean_effects]
    if "flaps" in sources:
        for effect in increments.flap_effects(sources["flaps"], h_ref):
            effects.append(("flaps", effect))
    if "elevator" in sources:
        elevator = _elevator_effect(sources["elevator"], h_ref)
        effects.append(("elevator", with_tail_arm(elevator, clean, h_ref)))
    for role, make_effect in _ROLL_CONTROLS.items():
        if role in sources:
            effects.append((role, make_effect(sources[role], h_ref)))
    # Power is an increment against the clean pages.
    if "power" in sources:
        effects.append(("power", power_effect(sources["power"], clean, h_ref)))
    if "ground" in sources:
        ground = ground_increments.ground_effect_increment(
            sources["ground"], h_ref, b=b, z_ref=z_ref
        )
        effects.append(("ground", ground))
    if "ground_flap" in sources:
        with_flaps = ground_increments.ground_flap(sources["ground_flap"], h_ref, b=b, z_ref=z_ref)
        effects.append(("ground_flap", with_flaps))
    if "ground_elevator" in sources:
        effects.append(
            ("ground_elevator", ground_increments.ground_elevator(sources["ground_elevator"]))
        )
    return effects


def _elevator_effect(elevator: Source, h_ref: float) -> Effect:
    """Return the effect of the elevator, or of an all-movable stabilizer without SYMFLP pages."""
    if elevator.has("trim_stabilizer") and not elevator.has("symflp"):
        return devices.stabilizer_effect(elevator, h_ref)
    return increments.elevator_effect(elevator, h_ref)


def _hinge_effects(sources: Mapping[str, Source], h_ref: float) -> list[Effect]:
    """Return the hinge moments.

    They keep the reference of their control, and they do not depend on the axes.
    """
    effects: list[Effect] = []
    if "elevator" in sources and sources["elevator"].has("symflp"):
        effects += devices.elevator_hinge(sources["elevator"], sources["clean"], h_ref)
    if "tabs" in sources:
        effects += devices.tab_effects(sources["tabs"], h_ref, bool(effects))
    if "aileron_hinge" in sources:
        effects += devices.aileron_hinge(sources["aileron_hinge"], h_ref)
    return effects


def _require_tail(clean: Source) -> None:
    """Raise if the pages are those of a wing-body, a wing or a body."""
    # Only parts without a tail are refused; a wing with a fin may be a complete aeroplane.
    configuration = clean.configuration
    has_tail = "HORIZONTAL" in configuration or "WING" not in configuration
    if not has_tail and configuration not in _PARTS:
        warn_user(
            f"{clean.role}: the pages of {clean.file} are those of {configuration}, which has no "
            f"horizontal tail; state `tailless` (--tailless) if the aircraft has none, else give "
            f"the case with HTPLNF"
        )
    if configuration in _PARTS:
        raise SchemaError(
            clean.role,
            [
                f"the pages of {clean.file} are those of {configuration}, not of the whole "
                f"aeroplane: stability and damping of the tail are not in "
                "them; give the case with HTPLNF and VTPLNF, or state `tailless` "
                "(--tailless) for an aircraft that has no tail"
            ],
        )
