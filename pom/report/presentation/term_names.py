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
_VARIABLES = {
    "delta_f": "flap extension",
    "gear": "gear extension",
    "speedbrake": "speed-brake extension",
    "h_agl": "ground effect",
    "delta_e": "elevator deflection",
    "delta_a": "aileron deflection",
    "delta_r": "rudder deflection",
}
_WHOLE = {
    "C*/*": "whole aerodynamic model",
    "engine/*": "whole engine model",
    "gear/*": "whole landing gear",
    "circuit/*": "all control circuits",
    "engine/static": "thrust and air flow of the engines over their speed",
    "engine/schedule": "commanded engine speed over the lever",
    "engine/dynamics": "how the engines follow the lever",
    "engine/rest": "the rest of the engine deck, such as fuel flow",
    "engine/thrust": "thrust and lag of the engines",
    "gear/steering": "nose-wheel steering",
    "gear/runway": "runway friction",
    "fuel/load": "fuel",
}


def term_words(term: str) -> str:
    """Return a term, a group of terms or a part of the aircraft in words; an unknown name gives an empty text.

    Examples
    --------
    >>> term_words("Cl/phat")
    'rolling-moment increment due to roll rate'
    >>> term_words("Cn/rhat_gear")
    'yawing-moment increment due to yaw rate, with gear down'
    >>> term_words("Cm/*"), term_words("*(gear)"), term_words("engine/static")
    ('all pitching-moment terms', 'all terms of gear extension', 'thrust and air flow of the engines over their speed')
    """
    if term in _WHOLE:
        return _WHOLE[term]
    if term.startswith("*(") and term[2:-1] in _VARIABLES:
        return f"all terms of {_VARIABLES[term[2:-1]]}"
    coefficient, _, name = term.partition("/")
    force = _COEFFICIENTS.get(coefficient, "")
    if force and name == "*":
        return f"all {force} terms"
    if coefficient == "gear":
        return f"{name} leg of the landing gear" if name in ("nose", "left", "right") else ""
    if not force or name == "basic":
        return f"basic {force.replace('-', ' ')}" if force else ""
    if name == "flap_slope":
        return f"change of {force} slope due to flap extension"
    cause, _, where = (name, "", "") if name in _CAUSES else name.partition("_")
    if cause not in _CAUSES or (where and where not in _WITH):
        return ""
    return f"{force} increment due to {_CAUSES[cause]}" + (f", {_WITH[where]}" if where else "")
