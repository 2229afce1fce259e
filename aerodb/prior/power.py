"""Power effects from pages with JETPWR or PROPWR: what running engines do to the airflow, per
thrust coefficient.

The program adds to its pages [routines JETPWE, PRPWEF]: the lift CT sin(alpha + i) of the thrust
itself, its moment about the moment centre (-CT z/cbar), the normal force of inlet or propeller, and
what jet or slipstream do to wing and tail; the drag of the thrust is not in it.  A simulation that
lets the thrust act at the engines would count the first two twice, so they are taken off here.

The rest is divided by the thrust coefficient of the deck and multiplies the regressor ``CT``: right
at that thrust, linear in between and beyond by assumption (the inlet force does not grow with
thrust, the downwash at the tail less than in proportion).
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
# what jet or slipstream, inlet or propeller do to the coefficients, per unit of CT: root mean
# square over alpha of the difference of pages
# with and without power, thrust itself taken off; the larger of two jets (CL 0.145 and 0.037, Cm
# 0.081 and 0.068) and of two propeller
# aircraft (CL 0.237 and 0.166, CD 0.145 and 0.164, Cm 0.307 and 0.276), rounded
_INDUCED_BY_JET = {"CL": 0.15, "Cm": 0.1}  # JETPWE sets the drag increment to zero
_INDUCED_BY_PROPELLER = {"CL": 0.25, "CD": 0.2, "Cm": 0.3}


@dataclass(frozen=True)
class Thrust:
    """The thrust of a deck: coefficient of all engines T / (qbar S), incidence [rad], height of its
    line over the moment centre [m].
    """

    CT: float
    incidence: float
    height: float
    jet: bool

    def itself(self, alpha: xr.DataArray, cbar: float) -> dict[str, xr.DataArray]:
        """Return what the thrust itself adds to CL, CD, Cm of a powered page; `alpha` [rad], `cbar`
        [m].
        """
        return {
            "CL": xr.DataArray(self.CT * np.sin(alpha + self.incidence)),
            "CD": xr.DataArray(0.0),
            "Cm": xr.DataArray(-self.CT * self.height / cbar),
        }

    @property
    def words(self) -> str:
        """What was taken off, for a comment."""
        line = f"line {self.height:.3f} m above the moment centre"
        return f"thrust itself taken off (CT sin(alpha + {self.incidence / DEGREE:g} deg), {line})"


def stated_thrust(given: Source) -> Thrust:
    """Return the thrust that the input cards describe.

    Raises
    ------
    SchemaError
        No or two power namelists, no input cards, or a thrust coefficient of zero.
    """
    names = {
        name for deck in given.decks for name in ("JETPWR", "PROPWR") if name in deck.namelists
    }
    if given.decks and len(names) != 1:
        raise SchemaError(
            given.role,
            [
                f"the input cards hold "
                f"{' and '.join(sorted(names)) or 'no JETPWR or PROPWR'}; one of them is "
                f"needed"
            ],
        )
    jet = names == {"JETPWR"}
    name, letter = ("JETPWR", "J") if jet else ("PROPWR", "P")
    CT = given.card(name, f"NENGS{letter}") * given.card(name, f"THSTC{letter}")
    if not CT > 0.0:
        raise SchemaError(
            given.role,
            [f"the thrust coefficient of the input cards is {CT:g}; a positive one is needed"],
        )
    incidence = given.card(name, f"AIETL{letter}", 0.0) * DEGREE
    z = given.card(name, "JEVLOC" if jet else "PHVLOC", 0.0) - given.card("SYNTHS", "ZCG", 0.0)
    x = given.card(name, "JEALOC", 0.0) - given.card("SYNTHS", "XCG", 0.0)
    height = np.cos(incidence) * z + np.sin(incidence) * x if jet else z  # as the program forms it
    if jet and given.card(name, "JIALOC", 0.0) > given.card("SYNTHS", "XW", 0.0):
        warn_user(
            f"{given.role}: the inlet lies behind the apex of the wing, where the program "
            f"extrapolates its chart of the upwash before it; "
            "the normal force of the inlet in CL/power and Cm/power is doubtful"
        )
    return Thrust(CT, incidence, float(height) * _LENGTH[given.decks[0].dim], jet)


def power_effect(given: Source, clean: Source, h_ref: float) -> Effect:
    """Return the effect ``power`` on CL, CD, Cm per unit of the thrust coefficient, without the
    thrust force itself.

    Notes
    -----
    A cell without value on the unpowered page is left out: the program prints the increment alone there.
    """
    engine = stated_thrust(given)
    other = [
        key
        for key, item in given.reference.items()
        if not np.isclose(item, clean.reference[key], rtol=1e-6, atol=1e-9)
    ]
    if other:
        raise SchemaError(
            given.role,
            [
                f"{', '.join(other)} of the powered pages are not those of the clean ones; "
                f"compute both with the same"
            ],
        )
    pages = _pages(given)
    h = float(pages["h"].sel(h=h_ref, method="nearest"))
    powered, free = pages.sel(h=h, drop=True), _pages(clean)
    if not np.isclose(free["h"], h, rtol=0.0, atol=1.0).any():
        raise SchemaError(
            given.role,
            [
                f"the powered pages stand at {h:.1f} m, the clean listing has no page there; "
                f"compute both at one altitude"
            ],
        )
    free = free.sel(h=h, method="nearest", drop=True)
    missing = [
        f"{mach:g}"
        for mach in powered["mach"].values
        if not np.isclose(free["mach"], mach, rtol=0.0, atol=1e-6).any()
    ]
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
    free = free.assign_coords(alpha=powered["alpha"])
    forces = (
        ("CL", "Cm") if engine.jet else ("CL", "CD", "Cm")
    )  # JETPWE sets the drag increment to zero
    whole = {c: powered[c] - free[c] for c in forces}
    itself = engine.itself(powered["alpha"], given.reference["cbar"])
    tables = drop_empty_tables(
        {c: table for c, table in whole.items() if float(np.abs(table).max()) > _ROUNDING[c]}
    )
    if not tables:
        warn_user(
            f"{given.role}: the powered pages are those without power; the power terms are "
            f"left absent"
        )
    comment = f"{engine.words}; computed at CT = {engine.CT:g}, linear in CT by assumption"
    rest = {c: (table - itself[c]) / engine.CT for c, table in tables.items()}
    return Effect("power", rest, "CT", references=given.place("static"), comment=comment)


def without_thrust(clean: Source, grid: xr.Dataset) -> tuple[xr.Dataset, str]:
    """Return powered static pages without the thrust itself, and the remainder in words.

    Parameters
    ----------
    clean : Source
        The powered pages with their input cards.
    grid : Dataset
        Their ``static`` leaf over ``mach`` and ``h``.

    Notes
    -----
    CLA and CMA of a powered page are those without power.  Where one is missing, CL or CM has no value without power and the program prints
    the increment alone there: such cells are taken out.  Lateral and dynamic derivatives are printed without power.
    """
    engine = stated_thrust(clean)
    itself = engine.itself(grid["alpha"], clean.reference["cbar"])
    slopes = {"CL": "CL_alpha", "Cm": "Cm_alpha"}
    tables = {
        c: (grid[c] - itself[c]).where(grid[slopes[c]].notnull() if c in slopes else True)
        for c in itself
    }
    kind, parts = (
        ("jet", "inlet and jet") if engine.jet else ("propeller", "propeller and slipstream")
    )
    words = (
        f"computed with {kind} power at CT = {engine.CT:g}: {engine.words}; what {parts} do "
        f"to the flow is in it, standard errors widened"
    )
    return grid.assign(tables), words


def with_power_in_it(prior: PriorErrors, clean: Source) -> PriorErrors:
    """Return the rules with what the power does to the flow in the standard errors of CL, CD and Cm
    ``basic``.
    """
    engine = stated_thrust(clean)
    induced = _INDUCED_BY_JET if engine.jet else _INDUCED_BY_PROPELLER
    return prior.widened({f"{c}/basic": engine.CT * size for c, size in induced.items()})


def _pages(place: Source) -> xr.Dataset:
    grid = place.grid("static")
    for axis in ("delta_f", "delta_e"):
        if axis in grid.dims:
            grid = grid.isel({axis: 0}, drop=True)
    return grid
