"""Reference quantities, axes and moment reference point of the aircraft for DATCOM's effects.

The place of that point on the mean chord is checked with the planform cards of the wing.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr

from aerodb.prior.effect_to_terms import fill_unprinted_cells
from aerodb.prior.sources import Source, warn_user
from aerodb.store.effects import (
    Effect,
    change_reference_quantities,
    rate_shift,
    rates_to_body,
    rotate_rolling_to_body,
    transfer_moments,
    with_added,
    without_partial_sums,
)
from datcom_io.arrays.conditions import LENGTH_UNITS
from datcom_io.decks.deck import Deck
from flightmech.aircraft.aircraft import Aircraft, DefaultNumber
from flightmech.errors import SchemaError

# Moment centres closer than this are equal within the rounding of print and drawing. [chords]
NEAR = 5e-4
FAR = 0.1  # distance of moment centres that is a mistake unless it is stated [chords]
_REFERENCE_DIFFERENCE = 0.01  # relative difference of reference quantities from which on to warn
_UNIT_TOLERANCE = 0.03
# Ratios of all lengths at once, by which a unit is mistaken.
_UNIT_FACTORS = {
    1.0 / 0.3048: "all lengths are 3.281 times those, as of feet taken as metres",
    0.3048: "all lengths are 0.3048 times those, as of metres taken as feet",
    1.0 / 0.0254: "all lengths are 39.4 times those, as of inches taken as metres",
    12.0: "all lengths are 12 times those, as of inches taken as feet",
    1.0 / 12.0: "all lengths are 1/12 of those, as of feet taken as inches",
}
# Difference of places on the mean chord from which on to warn. [chords]
_DIFFERENCE = 0.02
# Difference of the mean chord of the cards from that of the aircraft from which on the place means
# another chord, of that of the aircraft.
_OTHER_CHORD = 0.1
_INCOMPRESSIBLE = 0.3  # tables that begin below this Mach number are extended to Mach 0
Point = tuple[float, float, float]


def refer_to_aircraft(
    program_effects: list[tuple[str, Effect]],
    sources: Mapping[str, Source],
    aircraft: Aircraft,
    *,
    reference: Point,
) -> dict[str, Effect]:
    """Return the effects by name for the aircraft's reference quantities, axes and point."""
    quantities = {"S": aircraft.S, "cbar": aircraft.cbar, "b": aircraft.b}
    _warn_of_other_quantities(sources, quantities)
    effects, roles = {}, {}
    for role, effect in program_effects:
        old = sources[role].reference
        effects[effect.name] = change_reference_quantities(effect, old, quantities)
        roles[effect.name] = role
    # Stability to body axes.
    alpha = effects["basic"].tables["CL"]["alpha"]
    for name in ("beta", "aileron", "spoiler", "differential_tail"):
        if name in effects:
            effects[name] = rotate_rolling_to_body(effects[name], alpha)
    if "phat" in effects:
        effects["phat"], effects["rhat"] = rates_to_body(effects["phat"], effects["rhat"])
    # A derivative without a number stays absent: the change by a move would be all of it.
    given = {name: set(effect.tables) for name, effect in effects.items()}
    # Moments about the reference point of the aircraft.
    lengths = {"cbar": aircraft.cbar, "b": aircraft.b}
    for name, effect in effects.items():
        d = _reference_arm(sources[roles[name]], reference)
        if np.hypot(d[0], d[2]) > NEAR * aircraft.cbar and effect.tables:
            effects[name] = transfer_moments(effect, d, **lengths, alpha=alpha)
    # Flow angles at the new point change with the rates.
    d = _reference_arm(sources["clean"], reference)
    if np.hypot(d[0], d[2]) > NEAR * aircraft.cbar:
        changes = rate_shift(effects["basic"], effects["beta"], d, **lengths)
        for name, tables in changes.items():
            if name in effects and effects[name].tables:
                effects[name] = with_added(effects[name], tables)
    return {name: without_partial_sums(effect, given[name]) for name, effect in effects.items()}


def _warn_of_other_quantities(
    sources: Mapping[str, Source], quantities: Mapping[str, float]
) -> None:
    """Warn of listings whose reference quantities differ from those of the aircraft."""
    for role, source in sources.items():
        if text := describe_other_quantities(source.reference, quantities):
            warn_user(f"{role}: {text}")


def describe_other_quantities(
    reference: Mapping[str, float], quantities: Mapping[str, float]
) -> str:
    """Return how reference quantities differ from those of the aircraft by more than 1 %.

    The text is empty if they do not.
    """
    differences, ratios = [], []
    for key, item in quantities.items():
        # of an area the ratio of the lengths
        ratios.append((reference[key] / item) ** (0.5 if key == "S" else 1.0))
        if abs(reference[key] / item - 1) > _REFERENCE_DIFFERENCE:
            differences.append(f"{key} {reference[key]:.5g} against {item:.5g}")
    if not differences:
        return ""
    text = (
        f"{', '.join(differences)}: not the reference quantities of the aircraft; the coefficients "
        f"are referred to the aircraft's"
    )
    for factor, what in _UNIT_FACTORS.items():
        if all(abs(ratio / factor - 1.0) <= _UNIT_TOLERANCE for ratio in ratios):
            text += f"; {what}: check DIM of the deck and the units of the aircraft file"
    return text


def _reference_arm(source: Source, reference: Point) -> Point:
    """Return the vector from a reference point to the moment centre of a listing, body axes. [m]"""
    # x_cg counts aft and z_cg up; body axes point forward and down.
    return -source.reference["x_cg"] - reference[0], 0.0, -source.reference["z_cg"] - reference[2]


def find_reference_point(
    aircraft: Aircraft, sources: Mapping[str, Source], move_reference: bool
) -> Point:
    """Return the moment reference point of the aircraft, by default that of the cards. [m]"""
    if aircraft.reference is None:
        clean = sources["clean"]
        x_cg, z_cg = clean.reference["x_cg"], clean.reference["z_cg"]
        warn_user(
            f"the aircraft file gives no reference; the moment reference point is that of "
            f"the cards of {clean.file}, "
            f"XCG {x_cg:.4g} m, ZCG {z_cg:.4g} m: cg and all positions of the aircraft file "
            f"count from there"
        )
        return -x_cg, 0.0, -z_cg
    # A point of the aircraft file must be near the moment centre of every listing.
    x_ref, y_ref, z_ref = map(float, aircraft.reference)
    problems = []
    if abs(y_ref) > NEAR * aircraft.cbar:
        problems.append(
            f"the moment reference point lies {y_ref:.4f} m right of the plane of symmetry; "
            f"DATCOM's lies in it, set y to 0"
        )
    if not move_reference:
        problems += _distant_centres(sources, (x_ref, 0.0, z_ref), aircraft.cbar)
    if problems:
        raise SchemaError("aircraft", problems)
    return x_ref, y_ref, z_ref


def _distant_centres(sources: Mapping[str, Source], reference: Point, cbar: float) -> list[str]:
    """Return a problem for each moment centre that is far from the reference point."""
    # Listings of one centre share a message.
    roles_by_centre: dict[str, list[str]] = {}
    for role, source in sources.items():
        d = _reference_arm(source, reference)
        chords = float(np.hypot(d[0], d[2])) / cbar
        # Powered pages must have the moment centre of the clean ones: that is checked elsewhere.
        if chords <= FAR or role == "power":
            continue
        x_cg, z_cg = source.reference["x_cg"], source.reference["z_cg"]
        centre = (
            f"XCG {x_cg:.4g} m, ZCG {z_cg:.4g} m, which is reference = [{-x_cg:.4g}, 0, "
            f"{-z_cg:.4g}]"
        )
        text = f"{chords:.2g} chords from the moment centre of {source.file} ({centre}"
        roles_by_centre.setdefault(text, []).append(role)
    problems = []
    for text, roles in roles_by_centre.items():
        problems.append(
            f"reference [{reference[0]:.4g}, 0, {reference[2]:.4g}] m lies {text}; "
            f"{', '.join(roles)}); "
            f"correct it, leave it out to take that of the "
            "cards, or state `move_reference` (--move-reference) to have the moments transferred"
        )
    return problems


class MeanChord(NamedTuple):
    """Mean aerodynamic chord of a wing: length, and leading edge aft of the drawing datum [m]."""

    length: float
    leading_edge: float


def mean_chord_of(deck: Deck) -> MeanChord | None:
    """Return the mean chord of the wing of a deck, or None without all cards of its planform.

    The chords of both panels are straight lines, c(y). With the sweep at a share of the chord,

        cbar = 2/S int c^2 dy,  x_LE = 2/S int c x_LE(y) dy
    """
    unit = LENGTH_UNITS.get(deck.dim)
    root, tip = deck.value("WGPLNF", "CHRDR"), deck.value("WGPLNF", "CHRDTP")
    span, sweep = deck.value("WGPLNF", "SSPN"), deck.value("WGPLNF", "SAVSI")
    apex = deck.value("SYNTHS", "XW")
    # A scale factor multiplies some cards and not others.
    if unit is None or deck.value("SYNTHS", "SCALE") not in (None, 1.0):
        return None
    if root is None or tip is None or span is None or sweep is None or apex is None:
        return None
    share = deck.value("WGPLNF", "CHSTAT") or 0.0
    outer = deck.value("WGPLNF", "SSPNOP") or 0.0
    kink = deck.value("WGPLNF", "CHRDBP")
    if kink is None or not 0.0 < outer < span:
        kink = None
    stations, sweeps = [(0.0, root), (span, tip)], [sweep]
    if kink is not None:
        outer_sweep = deck.value("WGPLNF", "SAVSO")
        stations.insert(1, (span - outer, kink))
        sweeps.append(sweep if outer_sweep is None else outer_sweep)
    area = moment = square = 0.0
    line = apex + share * root
    for (y0, c0), (y1, c1), angle in zip(stations[:-1], stations[1:], sweeps):
        width = y1 - y0
        # Simpson's rule is exact for products of straight lines.
        y = width * np.array([0.0, 0.5, 1.0])
        c = c0 + (c1 - c0) * np.array([0.0, 0.5, 1.0])
        edge = line + np.tan(np.radians(angle)) * y - share * c
        weight = width * np.array([1.0, 4.0, 1.0]) / 6.0
        area += float(weight @ c)
        square += float(weight @ c**2)
        moment += float(weight @ (c * edge))
        line += float(np.tan(np.radians(angle))) * width
    if not area > 0.0:
        return None
    return MeanChord(unit * square / area, unit * moment / area)


def warn_of_other_place(
    aircraft: Aircraft, sources: Mapping[str, Source], reference: tuple[float, float, float]
) -> None:
    """Warn if the reference point lies elsewhere on the mean chord than the aircraft states.

    Parameters
    ----------
    aircraft : Aircraft
    sources : mapping of str to Source
        The planform is that of the cards of ``clean``.
    reference : (x, y, z)
        Moment reference point, body directions from the drawing datum. [m]
    """
    # The reference quantities alone, without a place on the chord, are enough for a database.
    stated = getattr(aircraft, "x_ref_mac", None)
    chords = {mean_chord_of(deck) for deck in sources["clean"].decks}
    if stated is None or len(chords) != 1:
        return
    (chord,) = chords
    if chord is None or abs(chord.length / aircraft.cbar - 1.0) > _OTHER_CHORD:
        return
    # Positions count aft in the drawing, and forward in body directions.
    place = (-reference[0] - chord.leading_edge) / aircraft.cbar
    if abs(place - stated) <= _DIFFERENCE:
        return
    origin = "the aircraft file gives it"
    if isinstance(stated, DefaultNumber):
        origin = "the default, the aircraft file does not give it"
    warn_user(
        f"x_ref_mac is {stated:.4g} ({origin}), and by the planform cards of "
        f"{sources['clean'].file} the reference point lies at {place:.4g} of the mean chord "
        f"(leading edge at {chord.leading_edge:.4g} m, mean chord {chord.length:.4g} m, reference "
        f"point {-reference[0]:.4g} m aft of the drawing datum): places of the c.g. and neutral "
        f"point in chords are shifted by the difference; set x_ref_mac = {place:.4g}"
    )


def find_reference_altitude(clean: Source, altitude: float | None) -> float:
    """Return the printed altitude nearest to the requested one, or the middle one. [m]

    It is 0 if the pages state Reynolds numbers, or pressure and temperature, and no altitude.
    """
    if not clean.has("static"):
        problem = f"the static pages of {clean.file} hold no row with an angle of attack; give "
        raise SchemaError(clean.role, [f"{problem}ALSCHD and NALPHA in the deck and run it again"])
    if not clean.has_altitude:
        warn_user(
            f"{clean.role}: the pages of {clean.file} state no altitude (Reynolds number, or "
            f"pressure and temperature, in the deck); the tables go over Mach number alone"
        )
        return 0.0
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


def find_basic_ranges(CL: xr.DataArray) -> dict[str, tuple[float, float]]:
    """Return the ranges of Mach number and incidence that every table must cover.

    They are those of the basic lift coefficient, down to Mach 0 if it begins incompressible.
    """
    filled, _, _ = fill_unprinted_cells(CL)
    machs, alphas = filled["mach"].values, filled["alpha"].values
    lowest = float(machs[0])
    if lowest <= _INCOMPRESSIBLE:
        lowest = 0.0
    return {
        "mach": (lowest, float(machs[-1])),
        "alpha": (float(alphas[0]), float(alphas[-1])),
    }
