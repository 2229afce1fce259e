"""A-priori standard errors of DATCOM's estimates, by term and class of method.

The standard error of a node is ``factor * hypot(relative * |value|, absolute)``.  That of the roll
damping also has `STALLED` of its difference from the largest damping within 10 deg of incidence:
the damping follows the local lift slope, and the stall that takes it away is a prediction of its
own.  The standard error is zero at nodes that are zero by definition (an increment at zero
deflection, a ground effect at height).  The relative and absolute figures depend on the term and
are those of the subsonic methods.  The factor depends on the class of method (static, dynamic,
control, ground, power, hinge) and on the speed regime.

Figures marked g are the engineering defaults of the project's identification guide (``7.6 A-priori
weighting``).  The others (j), and all factors, are engineering judgement by the kind of method:
fin-and-body build-ups, section data, charts of a few points, fairings between two regimes.  They
are starting values.  Replace them by the results of a comparison of estimates with flight: pass
``stderr=`` to `aerodb.from_datcom`.

`calibrated_errors.csv` has figures from aircraft with published derivatives in their place
(`calibrated_errors`): relative and absolute error, and the ratio of published to estimated values,
by program and term.  `benchmarks/prior_calibration.py` derives it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.resources import files
from typing import Any, TypeGuard

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import SchemaError, UnknownName
from flightmech.units import DEGREE

REGIMES = ("subsonic", "transonic", "supersonic")
# Last Mach number of DATCOM's subsonic methods and first one of its supersonic methods, unless the
# deck states others.
STMACH, TSMACH = 0.6, 1.4

CALIBRATED_MACH = 0.6
"""Largest Mach number of the calibration."""
CALIBRATIONS = "calibrated_errors.csv"
ERRORS = ("guide", "calibrated")
"""Kinds of standard errors: of the identification guide, and of the calibration."""

# By term: relative and absolute subsonic error, the latter in the unit of the table.
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
    "CD/flap": (0.30, 0.01),  # j: fades with incidence as induced drag, profile drag does not
    "Cm/flap": (0.30, 0.05),  # j: the tail in the downwash of the flaps is not in it
    "CL/flap_slope": (0.5, 0.1),  # j
    "Cm/flap_slope": (0.5, 0.05),  # j: exists only after a change of moment reference
    "CL/elevator": (0.20, 0.0),  # g
    "CD/elevator": (0.5, 0.005),  # j: zero where lifts cancel, profile drag is not
    "Cm/elevator": (0.15, 0.0),  # g
    "Cl/aileron": (0.20, 0.0),  # g
    "Cn/aileron": (1.0, 0.002),  # g; j: the estimate passes through zero with CL
    # no method in DATCOM; for other estimates
    "CY/aileron": (1.0, 0.01),  # j
    "CY/rudder": (0.25, 0.0),  # j
    "Cl/rudder": (0.5, 0.002),  # j: the arm is the small height of the fin
    "Cn/rudder": (0.20, 0.0),  # j: as the elevator
    "Cl/spoiler": (0.5, 0.002),  # j: charts of section data, nothing at small heights
    "Cn/spoiler": (0.5, 0.001),  # j
    "Cl/differential_tail": (0.25, 0.0),  # j: worse than the aileron, downwash of the other half
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
    "Ch_e/alpha": (0.3, 0.02),  # j: gap, nose and boundary layer are not in the charts
    "Ch_e/delta": (0.3, 0.0),  # j
    "Ch_e/tab": (0.1, 0.0),  # j: the engineer's own figure comes back
    "Ch_e/tab_gearing": (0.1, 0.0),  # j: as the tab
    "Ch_a/alpha": (0.3, 0.05),  # j: per radian
    "Ch_a/delta": (0.3, 0.0),  # j
}

# By class: factor in the transonic and in the supersonic regime, all by judgement.  The methods of
# ground effect and power are subsonic.
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
        ("flap", "flap_slope", "elevator", "aileron", "rudder", "spoiler", "differential_tail"),
        "control",
    ),
    **dict.fromkeys(("ground", "ground_flap", "ground_elevator"), "ground"),
    "power": "power",
}
# Term whose estimate follows the local lift slope: share of the loss by a predicted stall that
# enters its standard error (j), and the range of incidence in which the loss is looked for, with
# allowance for rounding. [rad]
STALLED = {"Cl/phat": 0.3}
_NEARBY = 10.0 * DEGREE * (1.0 + 1e-9)


def method_class(term: str) -> str:
    """Return the class of the method of a term: ``static dynamic control ground power hinge``.

    Examples
    --------
    >>> method_class("Cl/phat")
    'dynamic'
    """
    coefficient, _, contribution = term.partition("/")
    if coefficient.startswith("Ch_"):
        return "hinge"
    return _CLASS[contribution]


@dataclass(frozen=True)
class PriorErrors:
    """Rules of the standard errors: figures by term, factors by class, limits of the regimes.

    Attributes
    ----------
    terms : dict of str to (float, float)
        Relative and absolute standard error. [1, unit of the table]
    factors : dict of str to (float, float)
        Factors in the transonic and the supersonic regime, by class of method.
    stmach, tsmach : float
        Last Mach number of the subsonic methods, first one of the supersonic methods.
    ratios : dict of str to float
        Mean ratio of the true to the estimated slope of a term, up to `CALIBRATED_MACH`; 1 for a
        term that is absent.
    """

    terms: Mapping[str, tuple[float, float]] = field(default_factory=lambda: dict(PRIOR_ERRORS))
    factors: Mapping[str, tuple[float, float]] = field(default_factory=lambda: dict(REGIME_FACTORS))
    stmach: float = STMACH
    tsmach: float = TSMACH
    ratios: Mapping[str, float] = field(default_factory=dict)

    def regime(self, mach: float) -> str:
        """Return the speed regime of a Mach number."""
        if mach <= self.stmach:
            return "subsonic"
        if mach >= self.tsmach:
            return "supersonic"
        return "transonic"

    def widened(self, more: Mapping[str, float]) -> PriorErrors:
        """Return the rules with a further absolute standard error of some terms.

        It is added in quadrature. [unit of the table]
        """
        terms = dict(self.terms)
        for term, size in more.items():
            relative, absolute = self.terms[term]
            terms[term] = relative, float(np.hypot(absolute, size))
        return replace(self, terms=terms)

    def stderr(self, term: str, table: xr.DataArray) -> xr.DataArray:
        """Return the standard error of every node of a table.

        A table without a Mach axis counts as subsonic.  Beyond `CALIBRATED_MACH` the standard error
        of a calibrated term is at least that of the guide.
        """
        # Numbers, or tables over the Mach number.
        figures: tuple[Any, Any] = self.terms[term]
        relative, absolute = figures
        if term in self.ratios and "mach" in table.dims:
            beyond = table["mach"] > CALIBRATED_MACH
            guide_relative, guide_absolute = PRIOR_ERRORS[term]
            relative = xr.where(beyond, max(relative, guide_relative), relative)
            absolute = xr.where(beyond, max(absolute, guide_absolute), absolute)
        # Independent relative and absolute parts; near the stall the departure of the table, too.
        variance = (table * relative) ** 2 + absolute**2
        if term in STALLED and "alpha" in table.dims:
            variance = variance + (STALLED[term] * _departure_nearby(table)) ** 2
        stderr = variance**0.5
        if "mach" not in table.dims:
            return stderr
        factor = dict(zip(REGIMES, (1.0, *self.factors[method_class(term)])))
        mach = table["mach"].values
        factors = [factor[self.regime(m)] for m in mach]
        return stderr * xr.DataArray(factors, {"mach": mach}, "mach")


def _departure_nearby(table: xr.DataArray) -> xr.DataArray:
    """Return the difference of each node from the largest one within `_NEARBY` of incidence.

    The largest one is that of the largest absolute value.
    """
    last = table.transpose(..., "alpha")
    alpha, value = table["alpha"].values, last.values
    is_near = np.abs(np.subtract.outer(alpha, alpha)) <= _NEARBY
    largest = np.where(is_near, np.abs(value)[..., None, :], -1.0).argmax(axis=-1)
    departure = value - np.take_along_axis(value, largest, axis=-1)
    return last.copy(data=departure).transpose(*table.dims)


def errors_with(
    overrides: Mapping[str, tuple[float, float] | float] | None,
    stmach: float = STMACH,
    tsmach: float = TSMACH,
) -> PriorErrors:
    """Return the rules with the figures of a project in place of some defaults.

    Parameters
    ----------
    overrides : mapping, optional
        Relative and absolute standard error by term, ``{"Cm/qhat": (0.5, 0.0)}`` [1, unit of the
        table]; or a factor by regime and class, ``{"transonic static": 3.0}``.
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
    regime_names = []
    for regime in REGIMES[1:]:
        regime_names += [f"{regime} {kind}" for kind in factors]
    for name, item in (overrides or {}).items():
        if name in terms:
            terms[name] = _require_pair(name, item)
        elif name in regime_names:
            regime, kind = name.split()
            pair = list(factors[kind])
            pair[REGIMES[1:].index(regime)] = _require_factor(name, item)
            factors[kind] = pair[0], pair[1]
        else:
            hint = "stderr= takes terms that a listing can give, and regimes with a class"
            raise UnknownName(name, [*terms, *regime_names], "term", hint)
    return PriorErrors(terms, factors, stmach=stmach, tsmach=tsmach)


@cache
def read_calibration() -> pd.DataFrame:
    """Return the table of the calibration, one row per program and term.

    Returns
    -------
    DataFrame
        Columns ``program``, ``term``, ``method`` (class), ``count`` (aircraft), ``ratio``
        (published over estimated), ``factor`` (on the figures of the guide), ``relative``,
        ``absolute`` [1, unit of the table].
    """
    with (files("aerodb.prior") / CALIBRATIONS).open(encoding="ascii") as stream:
        return pd.read_csv(stream, comment="#")


def calibrated_errors(rules: PriorErrors, program: str, kept: Collection[str] = ()) -> PriorErrors:
    """Return rules with the calibrated figures and ratios of a program.

    Parameters
    ----------
    rules : PriorErrors
    program : str
        ``DATCOM``, ``OptVL`` or ``OptVL with body``.
    kept : collection of str
        Terms whose figures a project has given: they stay, without a ratio.

    Raises
    ------
    UnknownName
        A program without a calibration.
    """
    table = read_calibration()
    programs = list(table["program"].unique())
    if program not in programs:
        raise UnknownName(program, programs, "calibrated program", "use the errors of the guide")
    terms, ratios = dict(rules.terms), {}
    for row in table[table["program"] == program].to_dict("records"):
        if row["term"] not in kept:
            terms[row["term"]] = row["relative"], row["absolute"]
            ratios[row["term"]] = row["ratio"]
    return replace(rules, terms=terms, ratios=ratios)


def choose_errors(
    kind: str,
    program: str,
    overrides: Mapping[str, tuple[float, float] | float] | None,
    stmach: float = STMACH,
    tsmach: float = TSMACH,
) -> PriorErrors:
    """Return the rules of one of the kinds of `ERRORS` for a program.

    Raises
    ------
    UnknownName, SchemaError
        As `errors_with` and `calibrated_errors`, or the kind is unknown.
    """
    if kind not in ERRORS:
        raise UnknownName(kind, ERRORS, "kind of standard errors", "errors= takes one of them")
    rules = errors_with(overrides, stmach, tsmach)
    if kind == "guide":
        return rules
    return calibrated_errors(rules, program, overrides or {})


def describe_uncalibrated(rules: PriorErrors, table: xr.DataArray) -> str:
    """Return a sentence on the Mach numbers of a table that no calibration covers; empty for none.

    Parameters
    ----------
    rules : PriorErrors
        Rules without ratios are not calibrated at all, and the sentence is empty.
    table : DataArray
        Lift of the basic aeroplane.
    """
    if not rules.ratios or "mach" not in table.dims:
        return ""
    machs = [float(mach) for mach in table["mach"].values if mach > CALIBRATED_MACH]
    if not machs:
        return ""
    regimes = dict.fromkeys(rules.regime(mach) for mach in machs)
    return (
        f"Mach {', '.join(f'{mach:g}' for mach in machs)} ({', '.join(regimes)}): not calibrated; "
        f"the calibration ends at Mach {CALIBRATED_MACH:g}, so values are not corrected there, and "
        f"standard errors are judgement: those of the guide at least, with the bias of the "
        f"calibration and the factors of the regimes"
    )


def _require_pair(name: str, item: object) -> tuple[float, float]:
    """Return a pair of standard errors; raise for anything else."""
    if isinstance(item, tuple | list) and len(item) == 2:
        relative, absolute = item
        if _is_error(relative) and _is_error(absolute):
            return float(relative), float(absolute)
    raise SchemaError(
        "stderr", [f"{name} is {item!r}; give (relative, absolute), two numbers of zero or more"]
    )


def _require_factor(name: str, item: object) -> float:
    """Return a factor; raise for anything else."""
    if _is_error(item):
        return float(item)
    raise SchemaError("stderr", [f"{name} is {item!r}; give a factor of zero or more"])


def _is_error(number: object) -> TypeGuard[float]:
    """Return whether an object is a finite number of zero or more."""
    if isinstance(number, bool) or not isinstance(number, int | float):
        return False
    return bool(np.isfinite(number)) and number >= 0
