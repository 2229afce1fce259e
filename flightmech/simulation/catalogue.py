"""Names, units and start values of the inputs, outputs and parameters of a simulation model.

The kernel defines which names there are and in which order; this module defines what they mean.
The rows travel inside the compiled block, so that an FMU needs no second list.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence

from flightmech.aircraft.aircraft import Aircraft
from flightmech.names import lookup
from flightmech.simulation import submodels
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

MOST = sys.float_info.max

_RATES = {
    "u_dot": ("m s-2", "acceleration along body x, relative to the air"),
    "v_dot": ("m s-2", "acceleration along body y, relative to the air"),
    "w_dot": ("m s-2", "acceleration along body z, relative to the air"),
}
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
_AXES = "of the Earth axes"
_STATES = {
    **{axis: ("m", f"position along {axis} {_AXES}") for axis in "xyz"},
    **{f"v{axis}": ("m s-1", f"velocity along {axis} {_AXES}") for axis in "xyz"},
    **{f"q{i}": ("1", "attitude quaternion, Earth to body axes") for i in range(4)},
    "p": ("rad s-1", "roll rate relative to inertial space"),
    "q": ("rad s-1", "pitch rate relative to inertial space"),
    "r": ("rad s-1", "yaw rate relative to inertial space"),
}
_MODES = {
    "earth": ("0 flat, 1 WGS-84 rotating, 2 sphere at rest, 3 rotating sphere", 1.0, 0.0, 3.0),
    "engine": ("0 the lever drives, 1 N1, 2 thrust_drive", 0.0, 0.0, 2.0),
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
_START = {"V": 100.0, "h": 1000.0}
_START_NOTES = {
    "gamma": ", used by the trim only",
    "theta": ", not used by the trim",
    "alpha": ", first guess of the trim",
    "beta": ", first guess of the trim",
}


def expand_names(kind: int, items: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the names of one kind in the order of a block; `items` are those of `submodels.items`."""
    return [name for _, _, name in _expanded(kind, items)]


def _expanded(kind: int, items: Mapping[str, Sequence[str]]) -> Iterator[tuple[str, str, str]]:
    """Return group, item and name."""
    for group in list_name_groups():
        patterns = [row.pattern for row in computable_names(kind) if row.group == group]
        for item in items.get(group, ()):
            for pattern in patterns:
                yield group, item, pattern.replace("*", item)


def stages_by_name(kind: int, items: Mapping[str, Sequence[str]]) -> dict[str, int]:
    """Return the stage of every variable or target (`flightmech.simulation.kernel`: VARIABLE,
    TARGET) by its name.
    """
    stage = {(row.group, row.pattern): row.stage for row in computable_names(kind)}
    return {
        pattern.replace("*", item): at
        for (group, pattern), at in stage.items()
        for item in items.get(group, ())
    }


def input_rows(aircraft: Aircraft) -> list[CatalogueEntry]:
    """Return the rows of the inputs; their range is the travel of the control."""
    return _rows(INPUT, aircraft, _input)


def output_rows(aircraft: Aircraft) -> list[CatalogueEntry]:
    """Return the rows of the outputs."""
    return _rows(OUTPUT, aircraft, lambda name, _: _output(name))


def state_rows(aircraft: Aircraft) -> list[CatalogueEntry]:
    """Return the rows of the states."""
    return _rows(STATE, aircraft, lambda name, _: _state(name))


def parameter_rows(
    aircraft: Aircraft, terms: Sequence[str], powers: Mapping[str, float]
) -> list[CatalogueEntry]:
    """Return the rows of the parameters.

    `terms` are names such as ``CL/gear``, in the order of the kernel; `powers` are the exponents of
    those with a power factor.
    """
    rows = _rows(PARAMETER, aircraft, _parameter)
    rows += [
        CatalogueEntry(scale_name(name), "1", "1", f"scale of the term {name}", 1.0, -MOST, MOST, 0)
        for name in terms
    ]
    return rows + [
        CatalogueEntry(
            power_name(name),
            "1",
            "1",
            f"exponent of the power factor of {name}",
            value,
            -MOST,
            MOST,
            0,
        )
        for name, value in powers.items()
    ]


def _rows(
    kind: int, aircraft: Aircraft, core: Callable[[str, Aircraft], CatalogueEntry]
) -> list[CatalogueEntry]:
    return [
        submodels.submodel_row(kind, group, item, name, aircraft) if group else core(name, aircraft)
        for group, item, name in _expanded(kind, submodels.submodel_items(aircraft))
    ]


def variable_rows(names: Sequence[str], aircraft: Aircraft) -> list[CatalogueEntry]:
    """Return the rows of model variables."""
    rows = {row.name: row for row in _rows(VARIABLE, aircraft, lambda name, _: _row(name, name))}
    return [rows[name] for name in names]


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


def _row(
    name: str,
    like: str,
    description: str = "",
    value: float = 0.0,
    low: float = -MOST,
    high: float = MOST,
    flags: int = 0,
) -> CatalogueEntry:
    row = lookup(like)
    sign = f", positive {row.sign}" if row.sign else ""
    return CatalogueEntry(
        name,
        row.units,
        row.display_units,
        description or row.long_name + sign,
        value,
        low,
        high,
        flags,
    )


def _input(name: str, aircraft: Aircraft) -> CatalogueEntry:
    default = (0.0, 1.0) if name in ("gear", "speedbrake") else (-MOST, MOST)
    low, high = aircraft.limits.get(name, default)
    return _row(name, name, low=low, high=high)


def _state(name: str) -> CatalogueEntry:
    quantity = name.removeprefix("state.")
    units, text = _STATES[quantity]
    return CatalogueEntry(
        name,
        units,
        lookup(quantity).display_units if quantity in "pqr" else units,
        text,
        0.0,
        -MOST,
        MOST,
        0,
    )


def _output(name: str) -> CatalogueEntry:
    group, _, quantity = name.rpartition(".")
    if name == "out_of_range":
        return CatalogueEntry(
            name,
            "1",
            "1",
            "internal steps times axes outside the tables since the start",
            0.0,
            -MOST,
            MOST,
            0,
        )
    if group == "applied":
        return _row(name, quantity, f"{lookup(quantity).long_name} as applied: input and biases")
    if group == "trim" and quantity.endswith("_dot"):
        return _rate(name, quantity, "left by the trim")
    if group == "trim":
        found = "found by the trim" if quantity in ("alpha", "beta") else "bias found by the trim"
        return _row(name, quantity, f"{lookup(quantity).long_name}, {found}")
    return _row(name, name)


def _rate(name: str, quantity: str, remark: str) -> CatalogueEntry:
    if quantity in _RATES:
        units, text = _RATES[quantity]
        return CatalogueEntry(
            name,
            units,
            units,
            f"{text}, {remark}",
            0.0,
            -MOST,
            MOST,
            FIXED if name.startswith("init.") else 0,
        )
    return _row(
        name,
        quantity,
        f"{lookup(quantity).long_name}, {remark}",
        flags=FIXED if name.startswith("init.") else 0,
    )


def _parameter(name: str, aircraft: Aircraft) -> CatalogueEntry:
    group, _, quantity = name.partition(".")
    if group == "init":
        return _initial(name, quantity)
    if group == "mass":
        cg = dict(zip(("x_cg_b", "y_cg_b", "z_cg_b"), aircraft.cg, strict=True))
        return _row(
            name, quantity, value=cg[quantity] if quantity in cg else getattr(aircraft, quantity)
        )
    if group == "env":
        units, display, text, value = _ENVIRONMENT[quantity]
        return CatalogueEntry(name, units, display, text, value, -MOST, MOST, 0)
    if group == "bias":
        whose = " of each engine" if quantity in ("thrust", "throttle") else ""
        return _row(name, quantity, f"added to the {lookup(quantity).long_name}{whose}")
    return _mode(name, quantity, aircraft)


def _initial(name: str, quantity: str) -> CatalogueEntry:
    if quantity.endswith("_dot"):
        return _rate(name, quantity, "wanted by the trim")
    if quantity == "phi_range":
        return CatalogueEntry(
            name,
            "rad",
            "deg",
            "bank angle by which the trim may leave init.phi",
            0.0,
            0.0,
            0.5,
            FIXED,
        )
    text = f"{lookup(quantity).long_name} at the start{_START_NOTES.get(quantity, '')}"
    return _row(name, quantity, text, value=_START.get(quantity, 0.0), flags=FIXED)


def _mode(name: str, quantity: str, aircraft: Aircraft) -> CatalogueEntry:
    if quantity == "step":
        return CatalogueEntry(
            name, "s", "s", "largest internal step of the integration", 0.01, 1e-6, 1.0, FIXED
        )
    text, value, low, high = _MODES[quantity]
    if quantity == "engine" and any(
        engine.thrust is None and engine.deck is None for engine in aircraft.engines
    ):
        value = 2.0
    return CatalogueEntry(name, "1", "1", text, value, low, high, FIXED | INTEGER)
