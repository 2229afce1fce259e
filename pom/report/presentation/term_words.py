"""Words of terms of a model, of groups of terms and of parts of an aircraft."""

from __future__ import annotations

from flightmech.aircraft.controls import ICE

# Adjective of each coefficient.
_COEFFICIENTS = {
    "CL": "lift",
    "CD": "drag",
    "CY": "side-force",
    "Cl": "rolling-moment",
    "Cm": "pitching-moment",
    "Cn": "yawing-moment",
    "CX": "longitudinal-force",
    "CZ": "normal-force",
    "Ch_a": "aileron hinge-moment",
    "Ch_e": "elevator hinge-moment",
    "Ch_r": "rudder hinge-moment",
}
# Cause of an increment, by the first part of the name of its contribution.
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
    # hinge moments are named by the variable
    "alpha": "angle of attack",
    "delta": "the deflection of the surface",
    "delta_a": "aileron deflection",
    "delta_e": "elevator deflection",
    "delta_r": "rudder deflection",
    "delta_a3": "the cube of the aileron deflection",
    "delta_e3": "the cube of the elevator deflection",
    "delta_r3": "the cube of the rudder deflection",
    "delta_t": "trim-tab deflection",
    "tab_gearing": "the geared tab",
}
# Condition of an increment, by the second part of the name.
_CONDITIONS = {
    "flap": "with flaps",
    "gear": "with gear down",
    "ground": "in ground effect",
    "speedbrake": "with speed-brakes",
    "ice": "with ice",
    "beta": "in sideslip",
    "rudder": "with rudder deflection",
}
# Variable of a group of terms such as ``*(gear)``.
_VARIABLES = {
    "delta_f": "flap extension",
    "gear": "gear extension",
    "speedbrake": "speed-brake extension",
    ICE: "ice",
    "h_agl": "ground effect",
    "delta_e": "elevator deflection",
    "delta_a": "aileron deflection",
    "delta_r": "rudder deflection",
}
# Groups that have a name of their own.
_GROUPS = {
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
    "stall/separation": "flow separation",
}


def term_words(term: str) -> str:
    """Return a term, a group of terms or a part of the aircraft in words.

    An unknown name has an empty text.

    Examples
    --------
    >>> term_words("Cl/phat")
    'rolling-moment increment due to roll rate'
    >>> term_words("Cn/rhat_gear")
    'yawing-moment increment due to yaw rate, with gear down'
    >>> term_words("Cm/*"), term_words("*(gear)")
    ('all pitching-moment terms', 'all terms of gear extension')
    >>> term_words("CL/ground_basic_alpha")
    'change of basic lift in ground effect, with angle of attack'
    >>> term_words("Ch_e/delta_t")
    'elevator hinge-moment increment due to trim-tab deflection'
    >>> term_words("engine/static")
    'thrust and air flow of the engines over their speed'
    """
    if term in _GROUPS:
        return _GROUPS[term]
    if term.startswith("*(") and term[2:-1] in _VARIABLES:
        return f"all terms of {_VARIABLES[term[2:-1]]}"
    coefficient, _, name = term.partition("/")
    if coefficient == "gear":
        return f"{name} leg of the landing gear" if name in ("nose", "left", "right") else ""
    if coefficient not in _COEFFICIENTS:
        return ""
    return _contribution_words(_COEFFICIENTS[coefficient], name)


def _contribution_words(coefficient: str, name: str) -> str:
    """Return a contribution to a coefficient in words; an unknown contribution has none."""
    if name == "*":
        return f"all {coefficient} terms"
    if name == "basic":
        return f"basic {coefficient.replace('-', ' ')}"
    if name == "basic_ice":
        return f"change of basic {coefficient.replace('-', ' ')} by ice"
    if name == "flap_slope":
        return f"change of {coefficient} slope due to flap extension"
    if name.startswith("ground_") and name.removeprefix("ground_") not in _CONDITIONS:
        return _ground_words(coefficient, name.removeprefix("ground_"))
    # Some causes have an underscore, such as load_factor.
    cause, condition = name, ""
    if name not in _CAUSES:
        cause, _, condition = name.partition("_")
    if cause not in _CAUSES or (condition and condition not in _CONDITIONS):
        return ""
    text = f"{coefficient} increment due to {_CAUSES[cause]}"
    return f"{text}, {_CONDITIONS[condition]}" if condition else text


def _ground_words(coefficient: str, changed: str) -> str:
    """Return the change of a contribution by the ground in words (`aerodb.edit.ground_effect`)."""
    words, part = _contribution_words(coefficient, changed), ""
    if not words:
        # the part that grows with the angle of attack has a term of its own
        words = _contribution_words(coefficient, changed.removesuffix("_alpha"))
        part = ", with angle of attack"
    if not words:
        return ""
    return f"change of {words.removeprefix('change of ')} in ground effect{part}"
