"""A-priori standard errors of DATCOM's estimates, by method class.

The standard error of a node is ``factor * hypot(relative * |value|, absolute)``; nodes that are
zero by definition (an increment at zero deflection, a ground effect at height) have none.  Relative
and absolute figures go by term and are those of the subsonic methods; the factor goes by class of
method (static, dynamic, control, ground, power, hinge) and speed regime.  The relative figures are
the engineering defaults of the project's identification guide (``7.6 A-priori weighting``) where it
names the derivative (marked g); the others, and all factors, are engineering judgement (j), set by
the kind of method: fin-and-body build-ups, section data, charts of a few points, fairings between
two regimes.  They are starting values, to be replaced by a project's own comparison of estimates
with flight: pass ``stderr=`` to `aerodb.from_datcom`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TypeGuard

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError, UnknownName

REGIMES = ("subsonic", "transonic", "supersonic")
STMACH, TSMACH = (
    0.6,
    1.4,
)  # where DATCOM ends its subsonic methods and starts its supersonic ones, unless the deck states otherwise

# term: (relative, absolute), subsonic; the absolute one in the unit of the table
PRIOR_ERRORS: dict[str, tuple[float, float]] = {
    # static
    "CL/basic": (0.08, 0.05),  # g: slope 8 %, CL0 0.05
    "CD/basic": (0.15, 0.003),  # g: CD0 15 %
    "Cm/basic": (0.20, 0.02),  # g: slope 20 %; j: Cm0 0.02
    "CL/altitude": (0.5, 0.003),  # j: Reynolds-number effect, and rounding of the print
    "CD/altitude": (0.5, 0.001),  # j
    "Cm/altitude": (0.5, 0.003),  # j
    "CY/beta": (0.20, 0.02),  # j
    "Cl/beta": (0.35, 0.01),  # g
    "Cn/beta": (0.25, 0.01),  # g
    # dynamic
    "CL/qhat": (0.35, 0.0),  # j: a little worse than Cm_qhat
    "CD/qhat": (0.5, 0.1),  # j: exists only after a change of moment reference
    "Cm/qhat": (0.25, 0.0),  # g
    "CL/alphadothat": (0.5, 0.5),  # g; j: the estimate passes through zero beyond the stall
    "Cm/alphadothat": (0.5, 1.5),  # g; j: as CL
    "CY/phat": (0.5, 0.05),  # j
    "Cl/phat": (0.15, 0.02),  # g
    "Cn/phat": (0.5, 0.02),  # g
    "CY/rhat": (0.5, 0.2),  # j: exists only after a change of moment reference
    "Cl/rhat": (0.5, 0.02),  # g
    "Cn/rhat": (0.30, 0.02),  # g
    # control
    "CL/flap": (0.20, 0.02),  # j: as the elevator
    "CD/flap": (0.30, 0.005),  # j
    "Cm/flap": (0.30, 0.05),  # j: the tail in the downwash of the flaps is not in it
    "CL/flap_slope": (0.5, 0.1),  # j
    "Cm/flap_slope": (0.5, 0.05),  # j: exists only after a change of moment reference
    "CL/elevator": (0.20, 0.0),  # g
    "CD/elevator": (0.5, 0.002),  # j
    "Cm/elevator": (0.15, 0.0),  # g
    "Cl/aileron": (0.20, 0.0),  # g
    "Cn/aileron": (1.0, 0.002),  # g; j: the estimate passes through zero with CL
    "Cl/spoiler": (0.5, 0.002),  # j: charts of section data, nothing at small heights
    "Cn/spoiler": (0.5, 0.001),  # j
    "Cl/differential_tail": (
        0.25,
        0.0,
    ),  # j: a little worse than the aileron, downwash of the other half
    # ground
    "CL/ground": (0.3, 0.01),  # j: outside its linear range the program warns itself
    "CD/ground": (0.3, 0.003),  # j
    "Cm/ground": (0.4, 0.01),  # j
    "CL/ground_flap": (0.5, 0.01),  # j: pages drift from deflection to deflection
    "CD/ground_flap": (0.5, 0.003),  # j
    "Cm/ground_flap": (0.5, 0.01),  # j
    "CL/ground_elevator": (0.5, 0.01),  # j
    "CD/ground_elevator": (0.5, 0.003),  # j
    "Cm/ground_elevator": (0.5, 0.01),  # j
    # power: per unit of the thrust coefficient
    "CL/power": (0.5, 0.02),  # j: charts of few configurations; rounding of two prints over CT
    "CD/power": (0.5, 0.02),  # j
    "Cm/power": (0.5, 0.02),  # j
    # hinge
    "Ch_e/alpha": (
        0.3,
        0.02,
    ),  # j: depends on gap, nose and boundary layer, which the charts do not know
    "Ch_e/delta": (0.3, 0.0),  # j
    "Ch_e/tab": (0.1, 0.0),  # j: the engineer's own figure comes back
    "Ch_e/tab_gearing": (0.1, 0.0),  # j: as the tab
    "Ch_a/alpha": (0.3, 0.05),  # j: per radian
    "Ch_a/delta": (0.3, 0.0),  # j
}

# class: factor in the transonic and in the supersonic regime, j throughout; ground and power
# methods are subsonic ones
REGIME_FACTORS: dict[str, tuple[float, float]] = {
    "static": (2.0, 1.25),  # transonic: a fairing between the two others
    "dynamic": (2.0, 1.5),
    "control": (1.5, 1.5),
    "ground": (1.0, 1.0),
    "power": (1.0, 1.0),
    "hinge": (2.0, 1.5),
}
_CLASS = {
    **dict.fromkeys(("basic", "altitude", "beta"), "static"),
    **dict.fromkeys(("qhat", "alphadothat", "phat", "rhat"), "dynamic"),
    **dict.fromkeys(
        ("flap", "flap_slope", "elevator", "aileron", "spoiler", "differential_tail"), "control"
    ),
    **dict.fromkeys(("ground", "ground_flap", "ground_elevator"), "ground"),
    "power": "power",
}


def method_class(term: str) -> str:
    """Return the class of method a term of DATCOM comes from: ``static dynamic control ground power
    hinge``.

    Examples
    --------
    >>> method_class("Cl/phat")
    'dynamic'
    """
    coefficient, _, contribution = term.partition("/")
    return "hinge" if coefficient.startswith("Ch_") else _CLASS[contribution]


@dataclass(frozen=True)
class PriorErrors:
    """The rules in use: figures by term, factors by class, and where the regimes meet.

    Attributes
    ----------
    terms : dict of str to (float, float)
        Relative and absolute standard error. [1, unit of the table]
    factors : dict of str to (float, float)
        Class of method to its factor in the transonic and the supersonic regime.
    stmach, tsmach : float
        Last Mach number of the subsonic methods, first one of the supersonic methods.
    """

    terms: Mapping[str, tuple[float, float]] = field(default_factory=lambda: dict(PRIOR_ERRORS))
    factors: Mapping[str, tuple[float, float]] = field(default_factory=lambda: dict(REGIME_FACTORS))
    stmach: float = STMACH
    tsmach: float = TSMACH

    def regime(self, mach: float) -> str:
        """Return the speed regime of a Mach number."""
        return (
            REGIMES[0] if mach <= self.stmach else REGIMES[2] if mach >= self.tsmach else REGIMES[1]
        )

    def widened(self, more: Mapping[str, float]) -> PriorErrors:
        """Return the rules with a further absolute standard error of some terms, added in
        quadrature. [unit of the table]
        """
        wider = {
            term: (self.terms[term][0], float(np.hypot(self.terms[term][1], size)))
            for term, size in more.items()
        }
        return replace(self, terms={**self.terms, **wider})

    def stderr(self, term: str, table: xr.DataArray) -> xr.DataArray:
        """Return the standard error of every node of a table; one without a Mach axis counts as
        subsonic.
        """
        relative, absolute = self.terms[term]
        found = ((relative * table) ** 2 + absolute**2) ** 0.5
        if "mach" not in table.dims:
            return found
        factor = dict(zip(REGIMES, (1.0, *self.factors[method_class(term)])))
        mach = table["mach"].values
        return found * xr.DataArray([factor[self.regime(m)] for m in mach], {"mach": mach}, "mach")


def errors_with(
    overrides: Mapping[str, tuple[float, float] | float] | None,
    stmach: float = STMACH,
    tsmach: float = TSMACH,
) -> PriorErrors:
    """Return the rules with a project's own figures laid over them.

    Parameters
    ----------
    overrides : mapping, optional
        Term name to relative and absolute standard error, ``{"Cm/qhat": (0.5, 0.0)}`` [1, unit of
        the table]; or regime and class to a factor, ``{"transonic static": 3.0}``.
    stmach, tsmach : float
        As in `PriorErrors`.

    Raises
    ------
    UnknownName
        A term, or a pair of regime and class, that is not in the tables.
    SchemaError
        An entry that is not a pair of numbers, or not a number, zero or positive.
    """
    terms, factors = dict(PRIOR_ERRORS), dict(REGIME_FACTORS)
    known = [f"{regime} {kind}" for regime in REGIMES[1:] for kind in factors]
    for name, item in (overrides or {}).items():
        if name in terms:
            terms[name] = _pair(name, item)
        elif name in known:
            regime, kind = name.split()
            transonic, supersonic = factors[kind]
            factors[kind] = (
                (_factor(name, item), supersonic)
                if regime == REGIMES[1]
                else (transonic, _factor(name, item))
            )
        else:
            raise UnknownName(
                name,
                [*terms, *known],
                "term",
                "stderr= takes terms that a listing can give, and regimes with a class",
            )
    return PriorErrors(terms, factors, stmach, tsmach)


def _pair(name: str, item: object) -> tuple[float, float]:
    if isinstance(item, tuple | list) and len(item) == 2 and _sound(item[0]) and _sound(item[1]):
        return float(item[0]), float(item[1])
    raise SchemaError(
        "stderr", [f"{name} is {item!r}; give (relative, absolute), two numbers of zero or more"]
    )


def _factor(name: str, item: object) -> float:
    if _sound(item):
        return float(item)
    raise SchemaError("stderr", [f"{name} is {item!r}; give a factor of zero or more"])


def _sound(number: object) -> TypeGuard[float]:
    return (
        isinstance(number, int | float)
        and not isinstance(number, bool)
        and bool(np.isfinite(number))
        and number >= 0
    )
