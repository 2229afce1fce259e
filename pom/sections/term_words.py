"""Terms of a database in the words of LR-743 section 5.2: ``CL/gear`` is the lift increment due to gear extension."""

from __future__ import annotations

_COEFFICIENTS = {
    "CL": "lift",
    "CD": "drag",
    "CY": "side-force",
    "Cl": "rolling-moment",
    "Cm": "pitching-moment",
    "Cn": "yawing-moment",
    "CX": "longitudinal-force",
    "CZ": "normal-force",
}
_CAUSES = {
    "altitude": "altitude",
    "flap": "flap extension",
    "elevator": "elevator deflection",
    "tab": "tab deflection",
    "aileron": "aileron deflection",
    "rudder": "rudder deflection",
    "qhat": "pitch rate",
    "phat": "roll rate",
    "rhat": "yaw rate",
    "alphadothat": "rate of change of angle of attack",
    "betadothat": "rate of change of sideslip",
    "beta": "sideslip",
    "sideslip": "sideslip",
    "load_factor": "load factor",
    "speedbrake": "speed-brake extension",
    "gear": "gear extension",
    "ground": "ground effect",
}
_WITH = {
    "flap": "with flaps",
    "gear": "with gear down",
    "ground": "in ground effect",
    "speedbrake": "with speed-brakes",
    "beta": "in sideslip",
}


def term_words(term: str) -> str:
    """Return a term in words; a name that the house does not use gives an empty text.

    Examples
    --------
    >>> term_words("Cl/phat")
    'rolling-moment increment due to roll rate'
    >>> term_words("Cn/rhat_gear")
    'yawing-moment increment due to yaw rate, with gear down'
    """
    coefficient, _, name = term.partition("/")
    force = _COEFFICIENTS.get(coefficient, "")
    if not force or name == "basic":
        return f"basic {force.replace('-', ' ')}" if force else ""
    if name == "flap_slope":
        return f"change of {force} slope due to flap extension"
    cause, _, where = (name, "", "") if name in _CAUSES else name.partition("_")
    if cause not in _CAUSES or (where and where not in _WITH):
        return ""
    return f"{force} increment due to {_CAUSES[cause]}" + (f", {_WITH[where]}" if where else "")
