"""Names, units and start values of the inputs, outputs and parameters of a simulation model.

The kernel defines the names and their order.  This module defines their meaning.  The rows are part
of the compiled block, so that an FMU does not need a second list.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from flightmech.aircraft.aircraft import Aircraft
from flightmech.names import lookup
from flightmech.simulation import submodels
from flightmech.simulation.catalogue_row import MOST, make_row, make_vocabulary_row
from flightmech.simulation.kernel import (
    FIXED,
    INPUT,
    INTEGER,
    OUTPUT,
    PARAMETER,
    STATE,
    VARIABLE,
    CatalogueEntry,
    computable_names,
    list_name_groups,
)

# Accelerations that are not in the vocabulary: units, description.
_RATES = {
    "u_dot": ("m s-2", "acceleration along body x, relative to the air"),
    "v_dot": ("m s-2", "acceleration along body y, relative to the air"),
    "w_dot": ("m s-2", "acceleration along body z, relative to the air"),
}
# Units, display units, description, start value.
_ENVIRONMENT = {
    "delta_T": ("K", "K", "temperature offset from the standard atmosphere", 0.0),
    "qnh": (
        "Pa",
        "hPa",
        "pressure at mean sea level; of an altimeter setting at an elevation: "
        "air.sea_level_pressure",
        101325.0,
    ),
    "runway_elevation": ("m", "ft", "height of the runway over mean sea level", 0.0),
}
_QUATERNION = ("1", "attitude quaternion, Earth to body axes")
# States of the rigid body: units, description.
_STATES = {
    "x": ("m", "position along x of the Earth axes"),
    "y": ("m", "position along y of the Earth axes"),
    "z": ("m", "position along z of the Earth axes"),
    "vx": ("m s-1", "velocity along x of the Earth axes"),
    "vy": ("m s-1", "velocity along y of the Earth axes"),
    "vz": ("m s-1", "velocity along z of the Earth axes"),
    "q0": _QUATERNION,
    "q1": _QUATERNION,
    "q2": _QUATERNION,
    "q3": _QUATERNION,
    "p": ("rad s-1", "roll rate relative to inertial space"),
    "q": ("rad s-1", "pitch rate relative to inertial space"),
    "r": ("rad s-1", "yaw rate relative to inertial space"),
}
# Description, start value, limits.
_MODES = {
    "earth": ("0 flat, 1 WGS-84 rotating, 2 sphere at rest, 3 rotating sphere", 1.0, 0.0, 3.0),
    "engine": (
        "0 the lever drives, 1 N1, 2 thrust_drive, 3 the torque, 4 the speed of the propeller, 5 "
        "the manifold pressure",
        0.0,
        0.0,
        5.0,
    ),
    "controls": (
        "0 the surfaces drive, 1 the cockpit positions, 2 the pilot's forces",
        0.0,
        0.0,
        2.0,
    ),
    "rates": (
        "body rates of the aerodynamics: 0 relative to inertial space as gyros show them, 1 "
        "to the Earth",
        0.0,
        0.0,
        1.0,
    ),
    "trim": (
        "at the start: 0 none, 1 solve for thrust, 2 solve for throttle, 3 stand on the ground",
        0.0,
        0.0,
        3.0,
    ),
}
_START = {"V": 100.0, "h": 1000.0}  # start values of init.*; zero for the others
_START_NOTES = {
    "gamma": ", used by the trim only",
    "theta": ", not used by the trim",
    "alpha": ", first guess of the trim",
    "beta": ", first guess of the trim",
}


def expand_names(kind: int, items: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the names of one kind in the order of a block.

    `items` are those of `submodels.submodel_items`.
    """
    return [name for _, _, name in _expand_patterns(kind, items)]


def _expand_patterns(
    kind: int, items: Mapping[str, Sequence[str]]
) -> Iterator[tuple[str, str, str]]:
    """Return group, item and name of every name; an item replaces the star of a pattern."""
    for group in list_name_groups():
        patterns = [row.pattern for row in computable_names(kind) if row.group == group]
        for item in items.get(group, ()):
            for pattern in patterns:
                yield group, item, pattern.replace("*", item)


def stages_by_name(kind: int, items: Mapping[str, Sequence[str]]) -> dict[str, int]:
    """Return the stage of every variable or target by its name.

    `kind` is VARIABLE or TARGET of `flightmech.simulation.kernel`.
    """
    stages = {}
    for row in computable_names(kind):
        for item in items.get(row.group, ()):
            stages[row.pattern.replace("*", item)] = row.stage
    return stages


def input_rows(aircraft: Aircraft) -> list[CatalogueEntry]:
    """Return the rows of the inputs. Their range is the travel of the control."""
    return _list_rows(INPUT, aircraft, _input_row)


def output_rows(
    aircraft: Aircraft, items: Mapping[str, Sequence[str]] | None = None
) -> list[CatalogueEntry]:
    """Return the rows of the outputs.

    `items` are those of the groups, unless they are those of the aircraft alone.
    """
    return _list_rows(OUTPUT, aircraft, lambda name, _: _output_row(name), items=items)


def state_rows(aircraft: Aircraft) -> list[CatalogueEntry]:
    """Return the rows of the states."""
    return _list_rows(STATE, aircraft, lambda name, _: _state_row(name))


def parameter_rows(
    aircraft: Aircraft, terms: Sequence[str], powers: Mapping[str, float]
) -> list[CatalogueEntry]:
    """Return the rows of the parameters.

    `terms` are names such as ``CL/gear``, in the order of the kernel. `powers` are the exponents of
    the terms with a power factor.
    """
    rows = _list_rows(PARAMETER, aircraft, _parameter_row)
    for term in terms:
        rows.append(make_row(scale_name(term), "1", f"scale of the term {term}", value=1.0))
    for term, exponent in powers.items():
        text = f"exponent of the power factor of {term}"
        rows.append(make_row(power_name(term), "1", text, value=exponent))
    return rows


def variable_rows(names: Sequence[str], aircraft: Aircraft) -> list[CatalogueEntry]:
    """Return the rows of model variables."""
    rows = {}
    for row in _list_rows(VARIABLE, aircraft, lambda name, _: make_vocabulary_row(name, name)):
        rows[row.name] = row
    return [rows[name] for name in names]


def _list_rows(
    kind: int,
    aircraft: Aircraft,
    make_core_row: Callable[[str, Aircraft], CatalogueEntry],
    items: Mapping[str, Sequence[str]] | None = None,
) -> list[CatalogueEntry]:
    """Return the rows of one kind: those of the core, and those of the submodels."""
    rows = []
    if items is None:
        items = submodels.submodel_items(aircraft)
    for group, item, name in _expand_patterns(kind, items):
        if group:
            rows.append(submodels.submodel_row(kind, group, item, name=name, aircraft=aircraft))
        else:
            rows.append(make_core_row(name, aircraft))
    return rows


def scale_name(term: str) -> str:
    """Return the parameter that scales a term.

    Examples
    --------
    >>> scale_name("CL/gear")
    'term.CL.gear'
    """
    return "term." + term.replace("/", ".")


def power_name(term: str) -> str:
    """Return the parameter that is the exponent of a term's power factor."""
    return "power." + term.replace("/", ".")


def _input_row(name: str, aircraft: Aircraft) -> CatalogueEntry:
    # gear and speedbrake are parts of their travel
    default = (0.0, 1.0) if name in ("gear", "speedbrake") else (-MOST, MOST)
    low, high = aircraft.limits.get(name, default)
    return make_vocabulary_row(name, name, low=low, high=high)


def _state_row(name: str) -> CatalogueEntry:
    quantity = name.removeprefix("state.")
    units, text = _STATES[quantity]
    display_units = units
    if quantity in "pqr":
        display_units = lookup(quantity).display_units
    return make_row(name, units, text, display_units=display_units)


def _output_row(name: str) -> CatalogueEntry:
    group, _, quantity = name.rpartition(".")
    if name == "out_of_range":
        text = "internal steps times axes outside the tables since the start"
        return make_row(name, "1", text)
    # input plus biases, as it acts on the aircraft
    if group == "applied":
        text = f"{lookup(quantity).long_name} as applied: input and biases"
        return make_vocabulary_row(name, quantity, text)
    if group == "trim" and quantity.endswith("_dot"):
        return _rate_row(name, quantity, "left by the trim")
    if group == "trim":
        # the trim computes angles themselves, but controls and power as biases on the inputs
        remark = "found by the trim" if quantity in ("alpha", "beta") else "bias found by the trim"
        return make_vocabulary_row(name, quantity, f"{lookup(quantity).long_name}, {remark}")
    return make_vocabulary_row(name, name)


def _rate_row(name: str, quantity: str, remark: str) -> CatalogueEntry:
    """Return the row of an acceleration; that of ``init.*`` acts at the start only."""
    flags = FIXED if name.startswith("init.") else 0
    if quantity in _RATES:
        units, text = _RATES[quantity]
        return make_row(name, units, f"{text}, {remark}", flags=flags)
    text = f"{lookup(quantity).long_name}, {remark}"
    return make_vocabulary_row(name, quantity, text, flags=flags)


def _parameter_row(name: str, aircraft: Aircraft) -> CatalogueEntry:
    group, _, quantity = name.partition(".")
    if group == "init":
        return _start_row(name, quantity)
    if group == "mass":
        # the aircraft has the centre of gravity as a vector
        values = dict(zip(("x_cg_b", "y_cg_b", "z_cg_b"), aircraft.cg, strict=True))
        if quantity not in values:
            values[quantity] = getattr(aircraft, quantity)
        return make_vocabulary_row(name, quantity, value=values[quantity])
    if group == "env":
        units, display_units, text, value = _ENVIRONMENT[quantity]
        return make_row(name, units, text, display_units=display_units, value=value)
    if group == "bias":
        text = f"added to the {lookup(quantity).long_name}"
        if quantity in ("thrust", "throttle"):
            text += " of each engine"
        return make_vocabulary_row(name, quantity, text)
    return _mode_row(name, quantity, aircraft)


def _start_row(name: str, quantity: str) -> CatalogueEntry:
    """Return the row of a start value ``init.*``."""
    if quantity.endswith("_dot"):
        return _rate_row(name, quantity, "wanted by the trim")
    if quantity == "phi_range":
        return make_row(
            name,
            "rad",
            "bank angle by which the trim may leave init.phi",
            display_units="deg",
            low=0.0,
            high=0.5,
            flags=FIXED,
        )
    text = f"{lookup(quantity).long_name} at the start{_START_NOTES.get(quantity, '')}"
    value = _START.get(quantity, 0.0)
    return make_vocabulary_row(name, quantity, text, value=value, flags=FIXED)


def _mode_row(name: str, quantity: str, aircraft: Aircraft) -> CatalogueEntry:
    if quantity == "step":
        text = "largest internal step of the integration"
        return make_row(name, "s", text, value=0.01, low=1e-6, high=1.0, flags=FIXED)
    text, value, low, high = _MODES[quantity]
    if quantity == "engine":
        # an engine without tables has no lever: recorded thrust drives it
        for engine in aircraft.engines:
            if engine.thrust is None and engine.deck is None and engine.propeller is None:
                value = 2.0
    return make_row(name, "1", text, value=value, low=low, high=high, flags=FIXED | INTEGER)
