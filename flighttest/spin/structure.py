"""The model structures that [Gresham] found for a glide and for a spin of one small aeroplane.

References
----------
.. [Gresham] Gresham, Simmons, Hopwood, Woolsey, Spin Aerodynamic Modeling for a Fixed-Wing Aircraft Using Flight Data, eq. (24)-(35).
"""

from __future__ import annotations

from collections.abc import Mapping

from ..equation_error.model import Model, powers

GLIDE: Mapping[str, tuple[str, ...]] = {  # eq. (24)-(29)
    "CX": ("alpha", "qhat", "delta_e", "alpha**2", "beta**2", "1"),
    "CY": ("beta", "phat", "rhat", "delta_a", "delta_r", "1"),
    "CZ": ("alpha", "qhat", "delta_e", "beta**2", "1"),
    "Cl": ("beta", "phat", "rhat", "delta_a", "1"),
    "Cm": ("alpha", "qhat", "delta_e", "alpha**2", "alpha**3", "qhat**3", "1"),
    "Cn": ("beta", "phat", "rhat", "delta_a", "delta_r", "beta**2", "beta**3", "1"),
}
_RATES = ("Omegahat", "phat_osc", "qhat_osc", "rhat_osc")
_SURFACES = ("delta_e", "delta_a", "delta_r")
SPIN: Mapping[str, tuple[str, ...]] = {  # eq. (30)-(35)
    "CX": ("alpha", "alphadothat", "beta", *_RATES, *_SURFACES, "delta_e**2", "1"),
    "CY": ("alphadothat", "beta", "betadothat", *_RATES, *_SURFACES, "delta_e**2", "1"),
    "CZ": ("alpha", "alphadothat", "beta", *_RATES, *_SURFACES, "delta_e**2", "delta_e*delta_a", "1"),
    "Cl": ("alpha", "alphadothat", "beta", "betadothat", *_RATES, *_SURFACES, "delta_r**2", "1"),
    "Cm": ("alpha", "alphadothat", "beta", *_RATES, *_SURFACES, "delta_e**2", "delta_e*delta_a", "1"),
    "Cn": ("alpha", "alphadothat", "beta", "betadothat", *_RATES, *_SURFACES, "delta_a**2", "1"),
}


def models(structure: Mapping[str, tuple[str, ...]], nominal: Mapping[str, float] | None = None) -> dict[str, Model]:
    """Return one model per coefficient.

    Parameters
    ----------
    structure : mapping of str to tuple of str
        Coefficient to terms: `GLIDE`, `SPIN`, or any other.
    nominal : mapping of str to float, optional
        Values that variables count from, as `nominal_variables` gives them; variables that it lacks are absolute.  The
        published spin model is in deviations, the glide model is absolute. [SI]

    Raises
    ------
    UnknownName
        A variable or a coefficient that is not in the vocabulary.
    """
    found = {}
    for coefficient, terms in structure.items():
        variables = {name for term in terms for name in powers(term)}
        found[coefficient] = Model(coefficient, terms, {name: value for name, value in (nominal or {}).items() if name in variables})
    return found
