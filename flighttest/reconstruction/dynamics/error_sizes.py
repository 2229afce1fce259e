"""Sizes of the standard errors that a user states for the inputs of an identification.

A share that is given in per cent, or a time in milliseconds, makes every estimate worthless without
a failure: the intervals alone grow.  All ways in use the one check here.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import NamedTuple

from flightmech.errors import AeromatchWarning, SchemaError, UnknownName


class _Size(NamedTuple):
    """Unit of a standard error, a usual size, and the smallest one that is mostly a mistake."""

    unit: str
    usual: float
    largest: float


# The limits are a hundred, or for coefficients ten, times what a test programme has. An inertia
# from a formula, and a thrust from a sales leaflet, may be wrong by a fifth.
_SIZES = {
    "qbar": _Size("", 0.01, 0.2),
    "mass": _Size("", 0.005, 0.2),
    "inertia": _Size("", 0.02, 0.5),
    "thrust": _Size("", 0.02, 0.5),
    "pedal": _Size("", 0.002, 0.2),
    "timing": _Size("s", 0.002, 0.2),
    "lift": _Size("in CL", 0.3, 3.0),
    "drag": _Size("in CD", 0.03, 0.3),
    "pitching": _Size("in Cm", 0.1, 1.0),
    "along": _Size("m/s2", 0.002, 0.2),
    "wind": _Size("m/s", 5.0, 50.0),
}


def error_size_remarks(errors: Mapping[str, float], prefix: str = "error ") -> list[str]:
    """Return a line for every standard error that is too large for any aeroplane.

    Parameters
    ----------
    errors : mapping of str to float
        Standard errors by source; a source without a known size is not judged.
    prefix : str
        Words before the name of a source, such as ``errors.`` of a project file.

    Examples
    --------
    >>> (remark,) = error_size_remarks({"timing": 20.0, "mass": 0.005})
    >>> remark.partition(";")[0]
    'error timing = 20 is a standard error of 20 s'
    """
    remarks = []
    for source, error in errors.items():
        size = _SIZES.get(source)
        if size is None or error < size.largest:
            continue
        if not size.unit:
            remarks.append(
                f"{prefix}{source} = {error:g} is a standard error of {100.0 * error:g} %; it is a "
                f"share, 0.005 for half a per cent: correct it, or nearly nothing is identified"
            )
            continue
        remarks.append(
            f"{prefix}{source} = {error:g} is a standard error of {error:g} {size.unit}; "
            f"{size.usual:g} {size.unit} is usual: correct the number or its unit"
        )
    return remarks


def complete_errors(
    defaults: Mapping[str, float], errors: Mapping[str, float] | None
) -> dict[str, float]:
    """Return the standard errors of all sources: those that are given in place of the defaults.

    Parameters
    ----------
    defaults : mapping of str to float
        All sources.
    errors : mapping of str to float, optional
        Standard errors that replace defaults.

    Raises
    ------
    UnknownName
        A source that is not among the defaults.
    SchemaError
        Standard errors that are negative or not finite; all of them.

    Warns
    -----
    AeromatchWarning
        For each standard error that is too large for any aeroplane (`error_size_remarks`).
    """
    given = dict(errors or {})
    problems = []
    for source, error in given.items():
        if source not in defaults:
            raise UnknownName(source, defaults, "source of error")
        if not (math.isfinite(error) and error >= 0.0):
            problems.append(f"{source} = {error:g}; give a finite number that is not negative")
    if problems:
        raise SchemaError("standard errors", problems)
    for remark in error_size_remarks(given):
        warnings.warn(remark, AeromatchWarning, stacklevel=3)
    return {**defaults, **given}
