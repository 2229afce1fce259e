"""Effects of engine power on the airflow, per thrust coefficient, from JETPWR or PROPWR pages.

The program adds four parts to its pages [routines JETPWE, PRPWEF]: the lift CT sin(alpha + i) of
the thrust force, its moment about the moment centre (-CT z/cbar), the normal force of inlet or
propeller, and the effect of jet or slipstream on wing and tail.  The drag of the thrust is not
included.  A simulation that applies the thrust force at the engines would count the first two parts
twice, so that they are subtracted here.

The remainder is divided by the thrust coefficient of the deck and multiplies the regressor ``CT``.
It is exact at that thrust and linear in CT by assumption (the inlet force does not grow with
thrust, and the downwash at the tail grows less than in proportion).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from aerodb.prior.prior_errors import PriorErrors
from aerodb.prior.sources import Source, drop_empty_tables, warn_user
from aerodb.store.effects import Effect
from flightmech.errors import SchemaError
from flightmech.units import DEGREE, FOOT, INCH

_LENGTH = {"FT": FOOT, "IN": INCH, "M": 1.0, "CM": 0.01}
_ROUNDING = {"CL": 1e-3, "CD": 1e-3, "Cm": 1e-4}  # of the difference of two prints
# Size of the effect of power on the coefficients without the thrust force, per unit of CT: root
# mean square over alpha of the difference of pages with and without power.  The larger of two jets
# (CL 0.145 and 0.037, Cm 0.081 and 0.068) and of two propeller aircraft (CL 0.237 and 0.166, CD
# 0.145 and 0.164, Cm 0.307 and 0.276), rounded.
_INDUCED_BY_JET = {"CL": 0.15, "Cm": 0.1}  # JETPWE sets the drag increment to zero
_INDUCED_BY_PROPELLER = {"CL": 0.25, "CD": 0.2, "Cm": 0.3}
# Largest normal force of an inlet or a propeller without thrust, and its drag and moment, over the
# angles from -4 to 12 deg of an own light aircraft of two engines: the difference of its pages with
# engines of zero thrust to those without engines (CL 0.024, Cm 0.026 of two jets; CL 0.007, CD
# 0.004, Cm 0.046 of two propellers), rounded.
_IDLE = {
    "jet": {"CL": 0.025, "Cm": 0.03},
    "propeller": {"CL": 0.01, "CD": 0.005, "Cm": 0.05},
}


@dataclass(frozen=True)
class Thrust:
    """Thrust of a deck.

    Attributes
    ----------
    CT : float
        Thrust coefficient of all engines, T / (qbar S).
    incidence : float
        Incidence of the thrust line. [rad]
    height : float
        Height of the thrust line above the moment centre. [m]
    jet : bool
        Whether the engines are jets.
    """

    CT: float
    incidence: float
    height: float
    jet: bool

    def itself(self, alpha: xr.DataArray, cbar: float) -> dict[str, xr.DataArray]:
        """Return the contribution of the thrust force to CL, CD, Cm of a powered page.

        Incidence `alpha` in rad, chord `cbar` in m.
        """
        return {
            "CL": xr.DataArray(self.CT * np.sin(alpha + self.incidence)),
            "CD": xr.DataArray(0.0),
            "Cm": xr.DataArray(-self.CT * self.height / cbar),
        }

    @property
    def words(self) -> str:
        """Description of the subtracted thrust force, for a comment."""
        line = f"line {self.height:.3f} m above the moment centre"
        return f"thrust itself taken off (CT sin(alpha + {self.incidence / DEGREE:g} deg), {line})"


def stated_thrust(given: Source) -> Thrust:
    """Return the thrust that the input cards describe.

    Raises
    ------
    SchemaError
        No or two power namelists, no input cards, or a thrust coefficient of zero.
    """
    names: set[str] = set()
    for deck in given.decks:
        names.update({"JETPWR", "PROPWR"} & set(deck.namelists))
    if given.decks and len(names) != 1:
        namelists = " and ".join(sorted(names)) or "no JETPWR or PROPWR"
        raise SchemaError(given.role, [f"the input cards hold {namelists}; one of them is needed"])
    jet = names == {"JETPWR"}
    # The variables of both namelists differ in their last letter.
    name, letter, height_card = "PROPWR", "P", "PHVLOC"
    if jet:
        name, letter, height_card = "JETPWR", "J", "JEVLOC"
    CT = given.card(name, f"NENGS{letter}") * given.card(name, f"THSTC{letter}")
    if not CT > 0.0:
        raise SchemaError(
            given.role,
            [f"the thrust coefficient of the input cards is {CT:g}; a positive one is needed"],
        )
    incidence = given.card(name, f"AIETL{letter}", 0.0) * DEGREE
    # Height as the program computes it: for jets the distance of the line from the moment centre.
    z = given.card(name, height_card, 0.0) - given.card("SYNTHS", "ZCG", 0.0)
    x = given.card(name, "JEALOC", 0.0) - given.card("SYNTHS", "XCG", 0.0)
    height = z
    if jet:
        height = np.cos(incidence) * z + np.sin(incidence) * x
    if jet and given.card(name, "JIALOC", 0.0) > given.card("SYNTHS", "XW", 0.0):
        warn_user(
            f"{given.role}: the inlet lies behind the apex of the wing, where the program "
            f"extrapolates its chart of the upwash before it; "
            "the normal force of the inlet in CL/power and Cm/power is doubtful"
        )
    unit = _LENGTH[given.decks[0].dim]
    return Thrust(CT=CT, incidence=incidence, height=float(height) * unit, jet=jet)


def power_effect(given: Source, clean: Source, h_ref: float) -> Effect:
    """Return the effect ``power`` on CL, CD, Cm per unit of the thrust coefficient.

    The thrust force is not included.

    Parameters
    ----------
    given, clean : Source
        Pages with and without power.
    h_ref : float
        Altitude of the basic tables. [m]

    Raises
    ------
    SchemaError
        The pages differ in reference quantities, altitude, Mach numbers or angles of attack.

    Notes
    -----
    A cell without a value on the unpowered page is left out: the program prints only the increment
    there.
    """
    engine = stated_thrust(given)
    powered, free = _matching_pages(given, clean, h_ref)
    # JETPWE sets the drag increment to zero.
    coefficients: tuple[str, ...] = ("CL", "CD", "Cm")
    if engine.jet:
        coefficients = ("CL", "Cm")
    increments = {}
    for name in coefficients:
        table = powered[name] - free[name]
        if float(np.abs(table).max()) > _ROUNDING[name]:
            increments[name] = table
    increments = drop_empty_tables(increments)
    if not increments:
        warn_user(
            f"{given.role}: the powered pages are those without power; the power terms are "
            f"left absent"
        )
    # The thrust force acts at the engines in a simulation.
    force = engine.itself(powered["alpha"], given.reference["cbar"])
    tables = {}
    for name, table in increments.items():
        tables[name] = (table - force[name]) / engine.CT
    comment = f"{engine.words}; computed at CT = {engine.CT:g}, linear in CT by assumption"
    return Effect("power", tables, "CT", references=given.place("static"), comment=comment)


def _matching_pages(given: Source, clean: Source, h_ref: float) -> tuple[xr.Dataset, xr.Dataset]:
    """Return the pages with and without power at one altitude and equal Mach numbers and alphas."""
    differences = []
    for key, item in given.reference.items():
        if not np.isclose(item, clean.reference[key], rtol=1e-6, atol=1e-9):
            differences.append(key)
    if differences:
        raise SchemaError(
            given.role,
            [
                f"{', '.join(differences)} of the powered pages are not those of the clean ones; "
                f"compute both with the same"
            ],
        )
    pages, free = _undeflected_pages(given), _undeflected_pages(clean)
    h = float(pages["h"].sel(h=h_ref, method="nearest"))
    powered = pages.sel(h=h, drop=True)
    if not np.isclose(free["h"], h, rtol=0.0, atol=1.0).any():
        raise SchemaError(
            given.role,
            [
                f"the powered pages stand at {h:.1f} m, the clean listing has no page there; "
                f"compute both at one altitude"
            ],
        )
    free = free.sel(h=h, method="nearest", drop=True)
    missing = []
    for mach in powered["mach"].values:
        if not np.isclose(free["mach"], mach, rtol=0.0, atol=1e-6).any():
            missing.append(f"{mach:g}")
    if missing:
        raise SchemaError(
            given.role,
            [
                f"Mach {', '.join(missing)} stands on no page without power; the clean "
                f"listing must hold the Mach numbers of the powered one"
            ],
        )
    free = free.sel(mach=powered["mach"], method="nearest").assign_coords(mach=powered["mach"])
    if powered.sizes["alpha"] != free.sizes["alpha"] or not np.allclose(
        powered["alpha"], free["alpha"], rtol=0.0, atol=1e-9
    ):
        raise SchemaError(
            given.role,
            [
                "the angles of attack are not those of the clean listing; give the same "
                "schedule to both"
            ],
        )
    # Equal coordinates to the last bit, or the difference of the pages would drop cells.
    return powered, free.assign_coords(alpha=powered["alpha"])


def without_thrust(clean: Source, grid: xr.Dataset) -> tuple[xr.Dataset, str]:
    """Return powered static pages without the thrust force, and a description of the remainder.

    Parameters
    ----------
    clean : Source
        The powered pages with their input cards.
    grid : Dataset
        Their ``static`` leaf over ``mach`` and ``h``.

    Notes
    -----
    CLA and CMA of a powered page are those without power.  If one is missing, CL or CM has no value
    without power, and the program prints only the increment there.  Such cells are
    removed.  Lateral and dynamic derivatives are printed without power.
    """
    engine = stated_thrust(clean)
    force = engine.itself(grid["alpha"], clean.reference["cbar"])
    slopes = {"CL": "CL_alpha", "Cm": "Cm_alpha"}
    tables = {}
    for name, contribution in force.items():
        tables[name] = grid[name] - contribution
        if name in slopes:
            tables[name] = tables[name].where(grid[slopes[name]].notnull())
    kind, parts = "propeller", "propeller and slipstream"
    if engine.jet:
        kind, parts = "jet", "inlet and jet"
    description = (
        f"computed with {kind} power at CT = {engine.CT:g}: {engine.words}; what {parts} do "
        f"to the flow is in it, standard errors widened"
    )
    return grid.assign(tables), description


def with_power_in_it(prior: PriorErrors, clean: Source) -> PriorErrors:
    """Return the rules with the effect of power in the standard errors of the basic terms.

    These are CL, CD and Cm ``basic``.
    """
    engine = stated_thrust(clean)
    induced = _INDUCED_BY_PROPELLER
    if engine.jet:
        induced = _INDUCED_BY_JET
    return prior.widened({f"{name}/basic": engine.CT * size for name, size in induced.items()})


def with_idle_engines(prior: PriorErrors, clean: Source) -> PriorErrors:
    """Return the rules with the normal force of idle engines in the errors of the basic terms.

    Warns
    -----
    AeromatchWarning
        With the size of the widening.
    """
    sizes = _IDLE[clean.idle]
    part = "inlets" if clean.idle == "jet" else "propellers"
    listed = ", ".join(f"{name} {size:g}" for name, size in sizes.items())
    warn_user(
        f"{clean.role}: {clean.file} is computed with {clean.idle} engines of zero thrust: its "
        f"pages count as clean; the normal force of the {part} is in them, which widens the "
        f"standard errors of the basic terms by {listed}"
    )
    return prior.widened({f"{name}/basic": size for name, size in sizes.items()})


def _undeflected_pages(source: Source) -> xr.Dataset:
    """Return the static pages without deflection, which is the first one."""
    grid = source.grid("static")
    for axis in ("delta_f", "delta_e"):
        if axis in grid.dims:
            grid = grid.isel({axis: 0}, drop=True)
    return grid
