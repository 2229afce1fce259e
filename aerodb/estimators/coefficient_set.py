"""Neutral form of the coefficients that a program or a table gives: one number per row.

Every reader of this folder returns a `CoefficientSet`. Its table holds totals and derivatives of
all conditions, with the file and line of each number. Units are SI and radians, and rates are
p b/2V, q cbar/2V, r b/2V, whatever the file uses.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from flightmech.errors import SchemaError
from flightmech.short_text import ShortText

FORCES = {"stability": ("CL", "CD", "CY"), "body": ("CX", "CY", "CZ")}
MOMENTS = ("Cl", "Cm", "Cn")
RATES = ("phat", "qhat", "rhat")
CONDITIONS = ("mach", "alpha", "beta", *RATES)
VARIABLES = ("alpha", "beta", *RATES, "alphadothat", "mach", "u", "v", "w")
"""Variables of derivatives, in addition to the controls; u, v, w are the body velocities over V."""

_FIXED = (*CONDITIONS, "coefficient", "variable", "value", "file", "line")


@dataclass(frozen=True)
class EstimateReference:
    """Reference quantities of a set of coefficients, as its file states them.

    Attributes
    ----------
    S : float
        Wing area. [m2]
    cbar, b : float
        Mean chord and span. [m]
    x, y, z : float
        Moment centre from the origin of the drawing: aft, right, up. [m]
    """

    S: float
    cbar: float
    b: float
    x: float
    y: float = 0.0
    z: float = 0.0

    def in_units(self, unit: float) -> EstimateReference:
        """Return quantities that are stated in a unit of length [m] in metres."""
        lengths = {name: unit * getattr(self, name) for name in ("cbar", "b", "x", "y", "z")}
        return replace(self, S=unit**2 * self.S, **lengths)


@dataclass(frozen=True)
class CoefficientSet(ShortText):
    """Coefficients of an aeroplane by one program, or of one wind-tunnel or CFD table.

    Attributes
    ----------
    program : str
        Such as ``AVL``.
    files : tuple of str
    force_axes : str
        ``stability`` (CL, CD, CY) or ``body`` (CX forward, CY right, CZ down).
    moment_axes : str
        ``stability`` or ``body``: axes of the moments and of the rates of the derivatives.
    control_axes : str
        Axes of the moments in the derivatives with respect to controls.
    reference : EstimateReference or None
        None if the files do not state it.
    unit_stated : bool
        Whether the file states the unit of its lengths. If it does not, `reference` is in that
        unknown unit.
    controls : tuple of str
        Names of the controls, as in the file. Their sign is that of the file.
    numbers : DataFrame
        Columns ``mach``, ``alpha``, ``beta`` [rad], ``phat``, ``qhat``, ``rhat``, one column for
        each control [rad], ``coefficient``, ``variable`` (empty for the coefficient itself, else
        the variable or control of the derivative, per rad), ``value``, ``file``, ``line``.
    remarks : tuple of str
        What a reader of the file should know.
    cautions : tuple of str
        Faults of the set-up that the numbers show; a database of them is built with a warning.
    inviscid : bool
        Whether the drag has no friction.
    """

    program: str
    files: tuple[str, ...]
    force_axes: str
    moment_axes: str
    control_axes: str
    reference: EstimateReference | None
    controls: tuple[str, ...]
    numbers: pd.DataFrame
    unit_stated: bool = False
    remarks: tuple[str, ...] = field(default=())
    inviscid: bool = False
    cautions: tuple[str, ...] = ()

    def with_units(self, unit: float) -> CoefficientSet:
        """Return the set with the lengths of its file in metres; `unit` is in metres."""
        if self.reference is None or self.unit_stated:
            return self
        return replace(self, reference=self.reference.in_units(unit), unit_stated=True)


def make_numbers(rows: Iterable[Mapping[str, Any]], controls: Iterable[str]) -> pd.DataFrame:
    """Return the table of numbers with all its columns; an absent condition is zero."""
    table = pd.DataFrame(list(rows))
    columns = [*CONDITIONS, *controls, *_FIXED[len(CONDITIONS) :]]
    table = table.reindex(columns=columns)
    zero = dict.fromkeys([*CONDITIONS, *controls], 0.0) | {"variable": ""}
    # A file without a Mach number has none: it must not become Mach 0 in silence.
    del zero["mach"]
    return table.fillna(zero)


def join_sets(sets: Iterable[CoefficientSet]) -> CoefficientSet:
    """Return the numbers of several files of one program and aeroplane as one set.

    Raises
    ------
    SchemaError
        The files differ in program, axes, reference quantities or controls.
    """
    members = list(sets)
    first = members[0]
    problems = []
    for other in members[1:]:
        here = f"{other.files[0]} against {first.files[0]}"
        for name in ("program", "force_axes", "moment_axes", "control_axes"):
            if getattr(other, name) != getattr(first, name):
                problems.append(f"{here}: {name} {getattr(other, name)} and {getattr(first, name)}")
        if _differ(other.reference, first.reference):
            problems.append(f"{here}: {other.reference} and {first.reference}")
        if other.controls and first.controls and other.controls != first.controls:
            problems.append(
                f"{here}: controls {' '.join(other.controls)} and {' '.join(first.controls)}"
            )
    if problems:
        problems.append(
            "give files of one model of one aeroplane; others are a source of their own"
        )
        raise SchemaError("estimate", problems)
    controls = max((one.controls for one in members), key=len)
    numbers = pd.concat([one.numbers for one in members], ignore_index=True)
    numbers = numbers.fillna(dict.fromkeys(controls, 0.0))
    stating = next((one for one in members if one.reference is not None), first)
    files: list[str] = []
    remarks: dict[str, None] = {}
    cautions: dict[str, None] = {}
    for one in members:
        files += one.files
        remarks.update(dict.fromkeys(one.remarks))
        cautions.update(dict.fromkeys(one.cautions))
    return replace(
        first,
        reference=stating.reference,
        unit_stated=stating.unit_stated,
        inviscid=any(one.inviscid for one in members),
        files=tuple(files),
        controls=controls,
        numbers=numbers,
        remarks=tuple(remarks),
        cautions=tuple(cautions),
    )


def _differ(a: EstimateReference | None, b: EstimateReference | None) -> bool:
    """Return whether two sets of reference quantities differ by more than their print."""
    # A polar states none and takes that of the other files.
    if a is None or b is None:
        return False
    names = ("S", "cbar", "b", "x", "y", "z")
    first = np.array([getattr(a, name) for name in names])
    second = np.array([getattr(b, name) for name in names])
    return not np.allclose(first, second, rtol=1e-4, atol=1e-6 * a.cbar)
