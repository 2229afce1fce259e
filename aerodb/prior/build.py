"""DATCOM listings to an aerodynamic database: the a-priori model.

Assumptions: the aeroplane is symmetric; effects add up; increments printed for wing-body or at one
altitude hold for the whole aeroplane and every altitude.  What has no DATCOM method is absent and
counts as zero [LR743] 3.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from aerodb.prior import control_devices as devices
from aerodb.prior import control_devices as hinges
from aerodb.prior import increments
from aerodb.prior.effect_to_terms import fill_unprinted_cells, terms_of_effect
from aerodb.prior.power import power_effect, with_power_in_it
from aerodb.prior.prior_errors import errors_with
from aerodb.prior.sources import Source, collect_source, split_powered, warn_user
from aerodb.store.effects import (
    Effect,
    change_reference_quantities,
    rate_shift,
    rates_to_body,
    rotate_rolling_to_body,
    transfer_moments,
    with_added,
)
from aerodb.store.schema import SCHEME, make_database
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError

_NEAR = (
    5e-4  # moment centres closer than this many chords are the same: rounding of print and drawing
)
_FAR = 0.1  # moment centres farther apart than this many chords are a mistake, unless stated
_PARTS = ("WING-BODY", "WING ALONE", "DATCOM BODY ALONE", "BODY ALONE")
_ROLL_CONTROLS = {
    "aileron": increments.aileron_effect,
    "spoilers": devices.spoiler_effect,
    "differential_tail": devices.differential_tail,
}
_INCOMPRESSIBLE = 0.3  # below, tables may be held down to Mach 0
_Point = tuple[float, float, float]


def from_datcom(
    aircraft: Aircraft,
    *,
    clean: Any,
    flaps: Any = None,
    elevator: Any = None,
    aileron: Any = None,
    ground: Any = None,
    ground_flap: Any = None,
    ground_elevator: Any = None,
    power: Any = None,
    spoilers: Any = None,
    differential_tail: Any = None,
    tabs: Any = None,
    aileron_hinge: Any = None,
    altitude: float | None = None,
    powered: bool = False,
    tailless: bool = False,
    move_reference: bool = False,
    stderr: Mapping[str, tuple[float, float] | float] | None = None,
) -> xr.DataTree:
    """Return the database that Digital DATCOM listings give.

    Parameters
    ----------
    aircraft : Aircraft
        Name, reference quantities and moment reference point; coefficients are referred to them.
        Without a reference point that of the cards of `clean` is taken (XCG, ZCG).
    clean : Listing, Case, case tree or list of them
        The whole aeroplane, static and dynamic (card DAMP) pages; with PART pages the tail's share
        of missing alpha-dot derivatives. Cases with JETPWR or PROPWR among others without count as
        `power` unless that is given.
    flaps, elevator : as `clean`, optional
        SYMFLP on the wing, and on the tail. One condition per program run, or D(CM) drifts; several
        runs may be given. An all-movable stabilizer (TRIM without SYMFLP) may stand in for the
        elevator. Hinge moments of the elevator come along.
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
        SYMFLP on the wing with the geometry of the aileron, of which only the hinge moments are
        taken.
    altitude : float, optional
        Altitude of the basic tables, one of the printed ones; the middle one unless given. [m]
    powered : bool
        `clean` may hold pages with power only. The thrust itself is taken off by the cards; what
        jet or slipstream do to wing and tail stays in CL, CD and Cm, whose standard errors are
        widened by its size.
    tailless : bool
        `clean` may hold pages of a wing-body only: the aircraft has no tail.
    move_reference : bool
        The moment reference point of the aircraft may lie more than 0.1 chord from the moment
        centre of a listing.
    stderr : mapping, optional
        A-priori relative and absolute standard errors by term, ``{"Cm/qhat": (0.5, 0.0)}``, and
        factors by regime and class of method, ``{"transonic static": 3.0}``, over those of
        `aerodb.prior.prior_errors`.

    Returns
    -------
    DataTree
        The database: forces in stability axes, moments and rates in body axes about the aircraft's
        reference point. Root attribute ``absent`` lists the terms of the scheme that DATCOM does
        not give.

    Raises
    ------
    SchemaError
        A listing lacks the tables of its role, its conditions fill no grid, pages over ground are
        of several deflections of one run, the reference point lies off the plane of symmetry or
        more than 0.1 chord from a moment centre, or the clean pages are powered or those of a
        wing-body, unless stated.
    UnknownName
        `stderr` names an unknown term.

    Warns
    -----
    AeromatchWarning
        The reference point is that of the cards, the clean listing has no dynamic page, powered
        pages are used, reference quantities differ by more than 1 % (coefficients are
        re-referenced), D(CM) comes from a loop over several conditions, ground pages with elevator
        are given, a value is held into another speed regime, a spoiler of no height has a moment,
        Mach numbers stand at altitudes of their own, or a term of a listing given has to stay
        absent.
    """
    if power is None:
        free, with_power = split_powered(clean)
        clean, power = (free, with_power) if free and with_power else (clean, None)
    elif powered:
        raise SchemaError(
            "power",
            [
                "powered pages are stated to be the clean ones (powered); leave out power, "
                "or state it no longer"
            ],
        )
    given = {
        role: collect_source(
            role,
            listing,
            role == "power" or (role == "clean" and powered and not split_powered(listing)[0]),
        )
        for role, listing in {
            "clean": clean,
            "flaps": flaps,
            "elevator": elevator,
            "aileron": aileron,
            "ground": ground,
            "ground_flap": ground_flap,
            "ground_elevator": ground_elevator,
            "power": power,
            "spoilers": spoilers,
            "differential_tail": differential_tail,
            "tabs": tabs,
            "aileron_hinge": aileron_hinge,
        }.items()
        if listing is not None
    }
    prior = errors_with(stderr, *given["clean"].regimes)
    if not tailless:
        _require_tail(given["clean"])
    if not given["clean"].has("dynamic"):
        warn_user(
            f"clean: {given['clean'].file} has no dynamic page, so that the database has no "
            f"damping (qhat, phat, rhat): "
            "run the deck with a card DAMP"
        )
    if given["clean"].powered:
        prior = with_power_in_it(prior, given["clean"])
    reference = _reference_point(aircraft, given, move_reference)
    x_ref, y_ref, z_ref = reference
    h_ref = _reference_altitude(given["clean"], altitude)
    effects = _referred(_effects(given, h_ref, aircraft.b, z_ref), given, aircraft, reference)
    cover = _range_of(effects["basic"].tables["CL"])
    history = (
        f"from_datcom: {'; '.join(f'{role} from {place.file}' for role, place in given.items())}"
    )
    found: dict[str, xr.Dataset] = {}
    for effect in (*effects.values(), *_hinge_effects(given, h_ref)):
        found |= terms_of_effect(effect, prior, cover)
    return make_database(
        {name: found[name] for name in sorted(found, key=_place_in_scheme)},
        title=f"{aircraft.name}: a-priori database from Digital DATCOM",
        aircraft=aircraft.name,
        S=float(aircraft.S),
        cbar=float(aircraft.cbar),
        b=float(aircraft.b),
        x_ref=x_ref,
        y_ref=y_ref,
        z_ref=z_ref,
        force_axes="stability",
        source="Digital DATCOM",
        references="AFFDL-TR-79-3032; LR-743",
        history=history,
        comment="moments and rates in body axes; DATCOM's stability-axis ones are turned by alpha "
        "at the nodes",
        absent=" ".join(name for name in SCHEME if name not in found),
    )


def _effects(
    given: Mapping[str, Source], h_ref: float, b: float, z_ref: float
) -> list[tuple[str, Effect]]:
    """Return all effects with the role they come from, as DATCOM means them."""
    clean = given["clean"]
    found = [("clean", effect) for effect in increments.static_effects(clean, h_ref)]
    found.append(("clean", increments.sideslip_effect(clean, h_ref)))
    found += [("clean", effect) for effect in increments.pitch_rates(clean, h_ref)]
    if clean.has("dynamic"):
        found += [("clean", effect) for effect in increments.lateral_rates(clean, h_ref)]
    if "flaps" in given:
        found += [("flaps", effect) for effect in increments.flap_effects(given["flaps"], h_ref)]
    if "elevator" in given:
        movable = given["elevator"].has("trim_stabilizer") and not given["elevator"].has("symflp")
        found.append(
            (
                "elevator",
                (devices.stabilizer_effect if movable else increments.elevator_effect)(
                    given["elevator"], h_ref
                ),
            )
        )
    for role, effect in _ROLL_CONTROLS.items():
        if role in given:
            found.append((role, effect(given[role], h_ref)))
    if "power" in given:
        found.append(("power", power_effect(given["power"], clean, h_ref)))
    for role, over_ground in (
        ("ground", increments.ground_effect_increment),
        ("ground_flap", increments.ground_flap),
    ):
        if role in given:
            found.append((role, over_ground(given[role], h_ref, b, z_ref)))
    if "ground_elevator" in given:
        found.append(("ground_elevator", increments.ground_elevator(given["ground_elevator"])))
    return found


def _hinge_effects(given: Mapping[str, Source], h_ref: float) -> list[Effect]:
    """Return the hinge moments; they have the reference of their control and no axes to turn."""
    found: list[Effect] = []
    if "elevator" in given and given["elevator"].has("symflp"):
        found += hinges.elevator_hinge(given["elevator"], given["clean"], h_ref)
    if "tabs" in given:
        found += hinges.tab_effects(given["tabs"], h_ref, bool(found))
    if "aileron_hinge" in given:
        found += hinges.aileron_hinge(given["aileron_hinge"], h_ref)
    return found


def _referred(
    found: list[tuple[str, Effect]],
    given: Mapping[str, Source],
    aircraft: Aircraft,
    reference: _Point,
) -> dict[str, Effect]:
    """Return the effects by name with the aircraft's reference quantities, in body axes, about a
    reference point.
    """
    new = {"S": aircraft.S, "cbar": aircraft.cbar, "b": aircraft.b}
    for role, place in given.items():
        old = place.reference
        off = [
            f"{key} {old[key]:.5g} against {item:.5g}"
            for key, item in new.items()
            if abs(old[key] / item - 1) > 0.01
        ]
        if off:
            warn_user(
                f"{role}: {', '.join(off)}: not the reference quantities of the aircraft; "
                f"the coefficients are referred to the aircraft's"
            )
    effects = {
        effect.name: change_reference_quantities(effect, given[role].reference, new)
        for role, effect in found
    }
    roles = {effect.name: role for role, effect in found}
    alpha = effects["basic"].tables["CL"]["alpha"]
    for name in ("beta", "aileron", "spoiler", "differential_tail"):
        if name in effects:
            effects[name] = rotate_rolling_to_body(effects[name], alpha)
    if "phat" in effects:
        effects["phat"], effects["rhat"] = rates_to_body(effects["phat"], effects["rhat"])
    for name, effect in effects.items():
        d = _arm(given[roles[name]], reference)
        if np.hypot(d[0], d[2]) > _NEAR * aircraft.cbar and effect.tables:
            effects[name] = transfer_moments(effect, d, aircraft.cbar, aircraft.b, alpha)
    d = _arm(given["clean"], reference)
    if np.hypot(d[0], d[2]) > _NEAR * aircraft.cbar:
        for name, more in rate_shift(
            effects["basic"], effects["beta"], d, aircraft.cbar, aircraft.b
        ).items():
            if name in effects and effects[name].tables:
                effects[name] = with_added(effects[name], more)
    return effects


def _arm(place: Source, reference: _Point) -> tuple[float, float, float]:
    """Return the vector from a reference point to the listing's moment centre, body axes. [m]"""
    return -place.reference["x_cg"] - reference[0], 0.0, -place.reference["z_cg"] - reference[2]


def _reference_point(
    aircraft: Aircraft, given: Mapping[str, Source], move_reference: bool
) -> _Point:
    """Return the moment reference point of the aircraft, or of the cards of the clean aeroplane
    where it has none. [m]
    """
    if aircraft.reference is None:
        x_cg, z_cg = (given["clean"].reference[key] for key in ("x_cg", "z_cg"))
        warn_user(
            f"the aircraft file gives no reference; the moment reference point is that of "
            f"the cards of {given['clean'].file}, "
            f"XCG {x_cg:.4g} m, ZCG {z_cg:.4g} m: cg and all positions of the aircraft file "
            f"count from there"
        )
        return -x_cg, 0.0, -z_cg
    x_ref, y_ref, z_ref = (float(item) for item in aircraft.reference)
    problems = []
    if abs(y_ref) > _NEAR * aircraft.cbar:
        problems.append(
            f"the moment reference point lies {y_ref:.4f} m right of the plane of symmetry; "
            f"DATCOM's lies in it, set y to 0"
        )
    far: dict[str, list[str]] = {}
    for role, place in () if move_reference else given.items():
        d = _arm(place, (x_ref, 0.0, z_ref))
        chords = float(np.hypot(d[0], d[2])) / aircraft.cbar
        if (
            chords > _FAR and role != "power"
        ):  # powered pages must have the moment centre of the clean ones
            x_cg, z_cg = place.reference["x_cg"], place.reference["z_cg"]
            centre = (
                f"XCG {x_cg:.4g} m, ZCG {z_cg:.4g} m, which is reference = [{-x_cg:.4g}, 0, "
                f"{-z_cg:.4g}]"
            )
            far.setdefault(
                f"{chords:.2g} chords from the moment centre of {place.file} ({centre}", []
            ).append(role)
    problems += [
        f"reference [{x_ref:.4g}, 0, {z_ref:.4g}] m lies {text}; {', '.join(roles)}); "
        f"correct it, leave it out to take that of the "
        "cards, or state `move_reference` (--move-reference) to have the moments transferred"
        for text, roles in far.items()
    ]
    if problems:
        raise SchemaError("aircraft", problems)
    return x_ref, y_ref, z_ref


def _require_tail(clean: Source) -> None:
    """Refuse the pages of a wing-body, a wing or a body as the whole aeroplane."""
    found = clean.configuration
    if found in _PARTS:
        raise SchemaError(
            clean.role,
            [
                f"the pages of {clean.file} are those of {found}, not of the whole "
                f"aeroplane: stability and damping of the tail are not in "
                "them; give the case with HTPLNF and VTPLNF, or state `tailless` "
                "(--tailless) for an aircraft that has no tail"
            ],
        )


def _reference_altitude(clean: Source, altitude: float | None) -> float:
    heights = clean.grid("static")["h"].values
    if altitude is None:
        return float(heights[len(heights) // 2])
    nearest = float(heights[np.argmin(np.abs(heights - altitude))])
    if abs(nearest - altitude) > 1.0:
        printed = ", ".join(f"{h:.1f}" for h in heights)
        raise SchemaError(
            "clean", [f"altitude {altitude:.1f} m is not printed; choose one of {printed} m"]
        )
    return nearest


def _range_of(CL: xr.DataArray) -> dict[str, tuple[float, float]]:
    """Return the Mach numbers and angles of attack that every table must cover: those of CL, and
    the incompressible ones.
    """
    whole, _, _ = fill_unprinted_cells(CL)
    machs, alphas = whole["mach"].values, whole["alpha"].values
    return {
        "mach": (0.0 if machs[0] <= _INCOMPRESSIBLE else float(machs[0]), float(machs[-1])),
        "alpha": (float(alphas[0]), float(alphas[-1])),
    }


def _place_in_scheme(name: str) -> tuple[int, str]:
    return (SCHEME.index(name), name) if name in SCHEME else (len(SCHEME), name)
