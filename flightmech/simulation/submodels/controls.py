"""Catalogue rows of the control circuits."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flightmech.aircraft.controls import (
    _CONSTANTS,
    MOST,
    MOVES,
    RIGHT_ANGLE,
    Circuit,
    _units,
    check_circuit,
)
from flightmech.errors import SchemaError
from flightmech.names import lookup
from flightmech.simulation.kernel import FIXED, INPUT, INTEGER, PARAMETER, CatalogueEntry

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft

_DISPLAY = {"m": "cm", "rad": "deg"}
_SURFACE = {"column": "elevator", "wheel": "ailerons", "pedal": "rudder"}
# output behind the item: like the force (F), the travel (T) or a rate (R) of the item, deflection
# (D) or moment (H); description
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
        A circuit does not fit its control, or is none of column, wheel and pedal.
    """
    problems = [
        f"circuit.{item}: unknown; allowed: {', '.join(MOVES)}"
        for item in aircraft.circuits
        if item not in MOVES
    ]
    found = tuple(item for item in MOVES if item in aircraft.circuits)
    for item in found:
        problems += [
            f"circuit.{item}: {text}"
            for text in check_circuit(
                item, aircraft.circuits[item], aircraft.controls.get(MOVES[item])
            )
        ]
    if problems:
        raise SchemaError(aircraft.name, problems)
    return {"circuit": found}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of a name of a circuit."""
    if kind == PARAMETER:
        return _parameter(name, item, aircraft)
    if kind == INPUT:
        return _input(name, item, aircraft.circuits[item])
    return _output(name, item)


def _like(
    name: str, quantity: str, text: str, low: float = -MOST, high: float = MOST
) -> CatalogueEntry:
    like = lookup(quantity)
    return CatalogueEntry(name, like.units, like.display_units, text, 0.0, low, high, 0)


def _input(name: str, item: str, circuit: Circuit) -> CatalogueEntry:
    quantity = lookup(name)
    mode = 1 if name == item else 2
    text = f"{quantity.long_name}, positive {quantity.sign}; drives when mode.controls is {mode}"
    return _like(name, name, text, *(circuit.stops if name == item else ()))


def _output(name: str, item: str) -> CatalogueEntry:
    group, _, word = name.rpartition(".")
    if group == "trim":
        return _like(
            name,
            word,
            f"{lookup(word).long_name}, added at the start to hold the trimmed deflection",
        )
    if group == "applied":
        text = f"{lookup(word).long_name}, positive {lookup(word).sign}"
        return _like(
            name,
            word,
            text if word == item else f"{text}: with biases, or what holds the recorded motion",
        )
    kind, text = _OUTPUTS[word]
    text = f"{_SURFACE[item]}: {text}" if kind in "DH" else f"{item}: {text}"
    if kind == "R":
        units, display = ("rad s-1", "deg/s") if item == "wheel" else ("m s-1", "cm/s")
        return CatalogueEntry(name, units, display, text, 0.0, -MOST, MOST, 0)
    if kind == "H":
        return CatalogueEntry(name, "N m", "N m", text, 0.0, -MOST, MOST, 0)
    return _like(name, MOVES[item] if kind == "D" else f"F_{item}", text)


def _parameter(name: str, item: str, aircraft: Aircraft) -> CatalogueEntry:
    circuit, control = aircraft.circuits[item], aircraft.controls[MOVES[item]]
    assert control.gearing is not None
    word = name.rpartition(".")[2]
    linear = item != "wheel"
    if word in _CONSTANTS:
        constant = _CONSTANTS[word]
        units = _units(item, constant)
        high = 1.0 if word == "restitution" else MOST
        return CatalogueEntry(
            name,
            units,
            _DISPLAY.get(units, units),
            f"{item}: {constant.text}",
            getattr(circuit, word),
            constant.least,
            high,
            0,
        )
    if name.startswith("bias."):
        return _like(name, word, f"added to the {lookup(word).long_name}")
    travel = ("m", "cm") if linear else ("rad", "deg")
    low, high = aircraft.limits.get(MOVES[item], (-RIGHT_ANGLE, RIGHT_ANGLE))
    surface = _SURFACE[item]
    others: dict[str, tuple[str, str, str, float, float, int]] = {
        "order": (
            "1",
            "1",
            f"{item}: 2 one mass, 4 cockpit and surface, 6 cockpit and each aileron",
            circuit.order,
            2.0,
            FIXED | INTEGER,
        ),
        "step": ("s", "ms", f"{item}: sub-step", circuit.sub_step(control.gearing), 1e-6, 0),
        "S_hinge": ("m2", "m2", f"{surface}: area behind the hinge", control.S_hinge, 0.0, 0),
        "c_hinge": ("m", "cm", f"{surface}: mean chord behind the hinge", control.c_hinge, 0.0, 0),
        "gearing": ("m-1" if linear else "1",) * 2
        + (f"{surface}: deflection per travel at zero travel", control.gearing, -MOST, 0),
        "stop_low": (*travel, f"{item}: lower stop of the travel", circuit.stops[0], -MOST, 0),
        "stop_high": (*travel, f"{item}: upper stop of the travel", circuit.stops[1], -MOST, 0),
        "delta_low": (
            "rad",
            "deg",
            f"{surface}: lower stop of the surface, of each aileron",
            low,
            -MOST,
            0,
        ),
        "delta_high": (
            "rad",
            "deg",
            f"{surface}: upper stop of the surface, of each aileron",
            high,
            -MOST,
            0,
        ),
    }
    units, display, text, value, least, flags = others[word]
    return CatalogueEntry(name, units, display, text, float(value), least, MOST, flags)


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return no tables: hinge moments are terms of the database."""
    return iter(())
