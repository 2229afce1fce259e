"""The models of a coefficient over the ground: each free-air term with its own factor 1 + k h^s, and the rolling moment of bank.

References
----------
.. [LR743] Report LR-743, 1993, eq. (13), (14), table 2.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError

from ..equation_error.model import Model
from ..expressions.reading import parse
from ..expressions.separable_model import SeparableModel, ShapeParameter

HEIGHT = "h_agl"
EXPONENTS = (-4.0, -0.1)  # bounds of s: above -0.1 the ground is felt at all heights alike
FREE_AIR = 1e4  # height of a record that does not give it [m]
BANK = "CL*phi"  # the regressor of [LR743] eq. (14)
_LONGITUDINAL = ("CL", "CD", "Cm", "CX", "CZ")


def ground_terms(model: Model) -> tuple[str, ...]:
    """Return the terms that the ground may change: of CL, CD and Cm all, (13); of Cl the bank angle, (14).

    Raises
    ------
    IdentificationError
        A coefficient for which the report has no form.
    """
    if model.coefficient in _LONGITUDINAL:
        return tuple(model.terms)
    if model.coefficient == "Cl":
        return (BANK,)
    raise IdentificationError(f"no form of ground effect for {model.coefficient}; name its terms in `ground`, as {{'CY': ['beta']}}")


def exponent(term: str) -> str:
    """Return the name of the exponent of a ground term: ``s_alpha`` of ``alpha``, ``s_0`` of the constant."""
    return "s_" + ("0" if term == "1" else re.sub(r"\W+", "_", term.replace("**", "")).strip("_"))


def raised(term: str, name: str | None = None) -> str:
    """Return a term times h^s, in the spelling of a separable model."""
    return str(parse(f"{'' if term == '1' else term + '*'}{HEIGHT}^{name or exponent(term)}"))


def spelled(term: str) -> str:
    """Return a term of a `Model` in the spelling of a separable model."""
    return str(parse(term))


def model_over_ground(
    model: Model,
    ground: Sequence[str],
    held: bool = False,
    common: bool = False,
    exponents: tuple[float, float] = EXPONENTS,
    starts: Mapping[str, float] | None = None,
) -> SeparableModel:
    """Return the model of a coefficient in and out of ground effect.

    Parameters
    ----------
    model : Model
        Free air.
    ground : sequence of str
        Terms that the ground changes.
    held : bool
        The free-air terms are taken off the measured coefficient already.
    common : bool
        One exponent ``s`` for all ground terms, [LR743] eq. (11).
    exponents : (low, high)
        Bounds of the exponents.
    starts : mapping of str to float, optional
        First values of exponents by name, where the search need not begin anew.
    """
    name = "s" if common else None
    terms = [*(() if held else model.terms), *(raised(term, name) for term in ground)]
    names = dict.fromkeys(name or exponent(term) for term in ground)
    return SeparableModel(model.coefficient, terms, {one: ShapeParameter(*exponents, (starts or {}).get(one)) for one in names})


def with_heights(data: Sequence[xr.Dataset], names: Sequence[str]) -> list[xr.Dataset]:
    """Return manoeuvres that all have a height; one without counts as free air when its name is not informative else.

    Raises
    ------
    IdentificationError
        No manoeuvre with a height, or a height that is not positive.
    """
    if not any(HEIGHT in one for one in data):
        raise IdentificationError(
            f"no manoeuvre has {HEIGHT}; reconstruct with runway_elevation, so that heights over the runway are known"
        )
    found = []
    for one, name in zip(data, names):
        h = np.asarray(one[HEIGHT].values, float) if HEIGHT in one else np.array(FREE_AIR)
        if (h <= 0.0).any():
            raise IdentificationError(
                f"{name}: {HEIGHT} falls to {np.nanmin(h):.3g} m; h^s needs heights above zero: cut it at the touch-down"
            )
        found.append(one if HEIGHT in one else one.assign({HEIGHT: FREE_AIR}))
    return found
