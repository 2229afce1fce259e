"""The build-up of LR-743 eq. (1) to (11) for all six coefficients as one table, the empty scheme of a database.

Every entry is a product *K1 x table(axes) x regressors*; a coefficient is the sum of its entries.  LR-743 prints the equations of
the lift coefficient; those of the others are built alike.  The scheme holds no numbers: a term without a source is absent and
counts as zero [LR743] 3.1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flightmech import terms as _terms
from flightmech.errors import SchemaError, UnknownName

from .scheme_rows import HINGES, LATERAL, LONGITUDINAL, Row

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

HINGE = tuple(HINGES)  # hinge moments of elevator, ailerons, rudder: coefficients with any force axes
_COEFFICIENTS = ("CL", "CD", "Cm", "CY", "Cl", "Cn")
_CAUSES = ("gear", "speedbrake")  # extensions 0 ... 1: without a table K1 they multiply the term themselves


@dataclass(frozen=True)
class Slot:
    """One term of the scheme.

    Attributes
    ----------
    axes : tuple of str
        Axes that its table may have; a table without one of them is constant along it.
    regressors : tuple of str
        Variables that multiply the table. A control or rate may be an axis of the table instead: the table then holds the whole
        effect of the variable, not its slope.
    K1 : str
        Axis of the factor table, empty for none: ``x_cg``, ``speedbrake``, ``gear``, ``h_agl``.
    equation : str
        Number in LR-743; ``-`` for an addition of this package, ``like (n)`` for the counterpart in another coefficient.
    meaning : str
        What it is.
    from_datcom : str
        What the program gives, or why it gives nothing.
    identified : str
        What LR-743 4.5 found out about it in flight.
    """

    axes: tuple[str, ...]
    regressors: tuple[str, ...]
    K1: str
    equation: str
    meaning: str
    from_datcom: str
    identified: str


def lr743() -> dict[str, Slot]:
    """Return the scheme: name of each term (``"CL/elevator"``) to its `Slot`, in the order of the equations.

    References
    ----------
    .. [LR743] Report LR-743, 1993, eq. (1) to (11), sections 3.1 and 4.5.

    Examples
    --------
    >>> lr743()["CL/gear_mach"].regressors
    ('mach',)
    """
    groups = {**dict.fromkeys(("CL", "CD", "Cm"), LONGITUDINAL), **dict.fromkeys(("CY", "Cl", "Cn"), LATERAL), **HINGES}
    return {
        f"{coefficient}/{row[0]}": _slot(coefficient, row)
        for coefficient, rows in groups.items()
        for row in rows
        if not row[1] or coefficient in row[1].split()
    }


def scheme_table() -> pd.DataFrame:
    """Return the scheme as a DataFrame: a row per term, the fields of `Slot` as columns, lists as words."""
    import pandas as pd

    return pd.DataFrame.from_dict(scheme_texts(), orient="index").rename_axis("term")


def scheme_texts() -> dict[str, dict[str, str]]:
    """Return the rows of `scheme_table` by term."""
    return {
        name: {
            "K1": slot.K1,
            "axes": " ".join(slot.axes),
            "regressors": " ".join(slot.regressors),
            "equation": slot.equation,
            "meaning": slot.meaning,
            "from_datcom": slot.from_datcom,
            "identified": slot.identified,
        }
        for name, slot in lr743().items()
    }


def make(
    name: str,
    breakpoints: Mapping[str, Sequence[float]] | None = None,
    *,
    value: Any = 0.0,
    K1: Mapping[str, Sequence[float]] | None = None,
    power: _terms.Power | None = None,
    stderr: Any = None,
    source: str | None = None,
    **text: str,
) -> xr.Dataset:
    """Return a leaf of the scheme with the axes and regressors that belong there.

    Parameters
    ----------
    name : str
        Term of the scheme, such as ``"CL/gear"``.
    breakpoints : mapping of str to sequence, optional
        Axis to breakpoints: any of the axes of the `Slot`. A regressor given here becomes an axis instead. [SI]
    value : array or float
        Node values, in the order of `breakpoints`; one number is spread over all nodes. [1 or per unit of the regressors]
    K1 : mapping of str to (breakpoints, factors), optional
        Factor table over the axis of the slot, ``{"gear": ([0, 1], [0, 1])}``. Without it the undercarriage and the speed brake
        multiply the table themselves, the c.g. factor is one, and ground effect needs ``h_agl`` among the axes.
    power : Power, optional
        Power factor, ground effect in closed form; a power of ``h_agl`` is the height that ground effect needs.
    stderr, source, **text
        As in `flightmech.terms.make`: standard error of the nodes, where they come from, further attributes.

    Raises
    ------
    UnknownName
        A term that the scheme does not have.
    SchemaError
        An axis or factor that does not belong to the term, a shape that does not fit.

    Examples
    --------
    >>> make("CL/gear", {"alpha": [0.0, 0.2]}, value=0.01).attrs["regressors"]
    'gear'
    """
    scheme = lr743()
    if name not in scheme:
        raise UnknownName(name, scheme, "term", "aeromatch db scheme lists them")
    slot, axes, given = scheme[name], dict(breakpoints or {}), dict(K1 or {})
    problems = _axis_faults(slot, axes, given, "" if power is None else power.variable)
    shape = tuple(len(points) for points in axes.values())
    array = np.asarray(value, float)
    if array.shape not in ((), shape):
        problems.append(f"value has the shape {array.shape}, the breakpoints {' '.join(axes) or '(none)'} have {shape}")
    if problems:
        raise SchemaError(name, problems)
    words = [word for word in slot.regressors if word not in axes or word in slot.axes]
    if slot.K1 in _CAUSES and not given and slot.K1 not in axes:
        words.append(slot.K1)
    import xarray as xr

    factors = {axis: xr.DataArray(np.asarray(pair[1], float), {axis: np.asarray(pair[0], float)}, axis) for axis, pair in given.items()}
    filled = np.broadcast_to(array, shape).copy()
    leaf = _terms.make(filled, axes, words, K1=factors.get(slot.K1), power=power, stderr=stderr, source=source)
    return leaf.assign_attrs(text)


def _slot(coefficient: str, row: Row) -> Slot:
    """Return the entry of one coefficient; LR-743 prints equations and findings of lift, and of roll over ground."""
    _, _, axes, regressors, K1, equation, meaning, from_datcom, identified = row
    like = "like " if coefficient in ("CD", "Cm") and equation.startswith("(") else ""
    finding = identified if coefficient in ("CL", "Cl") else ""
    return Slot(tuple(axes.split()), tuple(regressors.split()), K1, like + equation, meaning, _given(from_datcom, coefficient), finding)


def _axis_faults(slot: Slot, axes: Mapping[str, Any], K1: Mapping[str, Any], power: str) -> list[str]:
    allowed = dict.fromkeys((*slot.axes, *slot.regressors, *((slot.K1,) if slot.K1 else ())))
    problems = [f"the axis {axis} does not belong here; allowed: {', '.join(allowed) or 'none'}" for axis in axes if axis not in allowed]
    for axis, pair in K1.items():
        if axis != slot.K1:
            problems.append(f"K1 over {axis} does not belong here; {f'it goes over {slot.K1}' if slot.K1 else 'the term has no factor'}")
        elif axis in axes:
            problems.append(f"{axis} is an axis of K1 and of the table; leave one of them out")
        elif len(pair) != 2 or len(pair[0]) != len(pair[1]):
            problems.append(f"K1 over {axis} is no pair of breakpoints and as many factors")
    if slot.K1 == "h_agl" and not K1 and "h_agl" not in (*axes, power):
        problems.append("depends on no height; give K1 over h_agl, h_agl among the breakpoints, or a power of it")
    return problems


def _given(text: str, coefficient: str) -> str:
    """Return what DATCOM gives for one coefficient: ``CL Cm: CLQ, CMQ`` names those it is meant for, the others have no method."""
    parts = [part.strip().partition(": ") for part in text.split("|")]
    meant = {word: what for who, _, what in parts for word in who.split() if word in _COEFFICIENTS}
    return meant.get(coefficient, "no method") if meant else text
