"""Catalogue rows of the control circuits."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from flightmech.aircraft.controls import (
    _CONSTANTS,
    MOVES,
    RIGHT_ANGLE,
    Circuit,
    _units,
    check_circuit,
)
from flightmech.errors import SchemaError
from flightmech.names import lookup
from flightmech.simulation.catalogue_row import MOST, make_row, make_vocabulary_row
from flightmech.simulation.kernel import FIXED, INPUT, INTEGER, PARAMETER, CatalogueEntry

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft

_DISPLAY = {"m": "cm", "rad": "deg"}
_SURFACE = {"column": "elevator", "wheel": "ailerons", "pedal": "rudder"}
# Outputs of a circuit: kind of the quantity, description. The kinds are force (F), rate of the
# travel (R), deflection (D) and hinge moment (H).
_OUTPUTS = {
    "rate": ("R", "rate of the travel"),
    "deflection": ("D", "deflection that the linkage gives"),
    "symmetric": (
        "D",
        "deflection that both ailerons have in common, trailing edge down; zero for other surfaces",
    ),
    "hinge_moment": ("H", "hinge moment of the air, positive as the deflection"),
    "F_aer": ("F", "force against the hinge moments"),
    "F_coul": ("F", "force against the Coulomb friction of all bodies"),
    "F_stop": ("F", "force against the stops of all bodies"),
    "F_g": ("F", "force against static unbalance and bob weight"),
    "F_nose": ("F", "force against the nose-wheel steering"),
}


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the circuits of the aircraft.

    Raises
    ------
    SchemaError
        A circuit does not fit its control, or is not one of column, wheel and pedal.
    """
    problems = []
    for item in aircraft.circuits:
        if item not in MOVES:
            problems.append(f"circuit.{item}: unknown; allowed: {', '.join(MOVES)}")
    circuits = tuple(item for item in MOVES if item in aircraft.circuits)
    for item in circuits:
        # a circuit needs the geometry of the surface that it moves
        control = aircraft.controls.get(MOVES[item])
        for text in check_circuit(item, aircraft.circuits[item], control):
            problems.append(f"circuit.{item}: {text}")
    if problems:
        raise SchemaError(aircraft.name, problems)
    return {"circuit": circuits}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of a name of a circuit."""
    if kind == PARAMETER:
        return _parameter_row(name, item, aircraft)
    if kind == INPUT:
        return _input_row(name, item, aircraft.circuits[item])
    return _output_row(name, item)


def _input_row(name: str, item: str, circuit: Circuit) -> CatalogueEntry:
    """Return the row of the travel or the force of the pilot."""
    quantity = lookup(name)
    low, high, mode = -MOST, MOST, 2
    if name == item:  # the travel
        (low, high), mode = circuit.stops, 1
    text = f"{quantity.long_name}, positive {quantity.sign}; drives when mode.controls is {mode}"
    return make_vocabulary_row(name, name, text, low=low, high=high)


def _output_row(name: str, item: str) -> CatalogueEntry:
    group, _, word = name.rpartition(".")
    # force or travel that the kernel adds at the start
    if group == "trim":
        text = f"{lookup(word).long_name}, added at the start to hold the trimmed deflection"
        return make_vocabulary_row(name, word, text)
    if group == "applied":
        text = f"{lookup(word).long_name}, positive {lookup(word).sign}"
        if word != item:
            text += ": with biases, or what holds the recorded motion"
        return make_vocabulary_row(name, word, text)
    kind, text = _OUTPUTS[word]
    # deflections and hinge moments are those of the surface, all others those of the circuit
    if kind == "D":
        return make_vocabulary_row(name, MOVES[item], f"{_SURFACE[item]}: {text}")
    if kind == "H":
        return make_row(name, "N m", f"{_SURFACE[item]}: {text}")
    if kind == "R" and item == "wheel":
        return make_row(name, "rad s-1", f"{item}: {text}", display_units="deg/s")
    if kind == "R":
        return make_row(name, "m s-1", f"{item}: {text}", display_units="cm/s")
    return make_vocabulary_row(name, f"F_{item}", f"{item}: {text}")


def _parameter_row(name: str, item: str, aircraft: Aircraft) -> CatalogueEntry:
    word = name.rpartition(".")[2]
    # constants of the circuit; their texts and lower limits are those of the aircraft file
    if word in _CONSTANTS:
        constant = _CONSTANTS[word]
        units = _units(item, constant)
        return make_row(
            name,
            units,
            f"{item}: {constant.text}",
            display_units=_DISPLAY.get(units, units),
            value=getattr(aircraft.circuits[item], word),
            low=constant.least,
            high=1.0 if word == "restitution" else MOST,
        )
    if name.startswith("bias."):
        return make_vocabulary_row(name, word, f"added to the {lookup(word).long_name}")
    return _linkage_row(name, word, item, aircraft=aircraft)


def _linkage_row(name: str, word: str, item: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the row of a parameter of stops, gearing, surface or integration."""
    if word in ("S_hinge", "c_hinge", "gearing", "delta_low", "delta_high"):
        columns = _surface_columns(item, aircraft)[word]
    else:
        columns = _circuit_columns(item, aircraft)[word]
    columns["value"] = float(columns["value"])
    return make_row(name, **columns)


def _circuit_columns(item: str, aircraft: Aircraft) -> dict[str, dict[str, Any]]:
    """Return the columns of the rows of order, sub-step and stops of a circuit."""
    circuit, control = aircraft.circuits[item], aircraft.controls[MOVES[item]]
    assert control.gearing is not None
    travel = {"units": "m", "display_units": "cm"}
    if item == "wheel":  # it turns, column and pedals move
        travel = {"units": "rad", "display_units": "deg"}
    return {
        "order": {
            "units": "1",
            "description": f"{item}: 2 one mass, 4 cockpit and surface, 6 cockpit and each aileron",
            "value": circuit.order,
            "low": 2.0,
            "flags": FIXED | INTEGER,
        },
        "step": {
            "units": "s",
            "display_units": "ms",
            "description": f"{item}: sub-step",
            "value": circuit.sub_step(control.gearing),
            "low": 1e-6,
        },
        "stop_low": {
            **travel,
            "description": f"{item}: lower stop of the travel",
            "value": circuit.stops[0],
        },
        "stop_high": {
            **travel,
            "description": f"{item}: upper stop of the travel",
            "value": circuit.stops[1],
        },
    }


def _surface_columns(item: str, aircraft: Aircraft) -> dict[str, dict[str, Any]]:
    """Return the columns of the rows of the surface that a circuit moves."""
    surface, control = _SURFACE[item], aircraft.controls[MOVES[item]]
    angle = {"units": "rad", "display_units": "deg"}
    # a surface without limits may turn by a right angle
    low, high = aircraft.limits.get(MOVES[item], (-RIGHT_ANGLE, RIGHT_ANGLE))
    return {
        "S_hinge": {
            "units": "m2",
            "description": f"{surface}: area behind the hinge",
            "value": control.S_hinge,
            "low": 0.0,
        },
        "c_hinge": {
            "units": "m",
            "display_units": "cm",
            "description": f"{surface}: mean chord behind the hinge",
            "value": control.c_hinge,
            "low": 0.0,
        },
        "gearing": {
            "units": "1" if item == "wheel" else "m-1",
            "description": f"{surface}: deflection per travel at zero travel",
            "value": control.gearing,
        },
        "delta_low": {
            **angle,
            "description": f"{surface}: lower stop of the surface, of each aileron",
            "value": low,
        },
        "delta_high": {
            **angle,
            "description": f"{surface}: upper stop of the surface, of each aileron",
            "value": high,
        },
    }


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return no tables: hinge moments are terms of the database."""
    return iter(())
