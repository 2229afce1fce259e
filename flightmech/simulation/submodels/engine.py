"""Catalogue rows and tables of the engines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from flightmech.aircraft.engine import MOST, Engine, list_leaves
from flightmech.aircraft.propulsion.engine_deck import OWN
from flightmech.aircraft.propulsion.shaft_tables import SHAFT_VARIABLES
from flightmech.errors import SchemaError
from flightmech.simulation.catalogue_row import make_row, make_vocabulary_row
from flightmech.simulation.kernel import INPUT, OUTPUT, STATE, VARIABLE, CatalogueEntry
from flightmech.terms import list_regressors

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft

# Constants of engine and spools: units, display units, description, least value.
_CONSTANTS: dict[str, tuple[str, str, str, float]] = {
    "time_constant": ("s", "s", "first-order lag of the thrust", 0.0),
    "angular_momentum": (
        "kg m2 s-1",
        "kg m2 s-1",
        "angular momentum of the rotors along the thrust",
        -MOST,
    ),
    "lever_delay": ("s", "s", "transport delay of the power lever", 0.0),
    "pla_idle": ("rad", "deg", "lever angle at throttle 0", -MOST),
    "pla_full": ("rad", "deg", "lever angle at throttle 1", -MOST),
    "n1_rundown": ("s", "s", "time constant of n1 towards windmilling", 0.0),
    "n2_rundown": ("s", "s", "time constant of n2 towards windmilling", 0.0),
    "starter_speed": ("1", "%", "speed to which the starter turns the gas generator", 0.0),
    "starter_time": ("s", "s", "time constant of the starter", 0.0),
    "light_speed": ("1", "%", "least speed of the gas generator to light", 0.0),
    "sustain_speed": ("1", "%", "speed of the gas generator below which the flame goes out", 0.0),
    "flame_time": ("s", "s", "time constant of the flame", 0.0),
    "itt_time": ("s", "s", "lag of the inter-turbine temperature", 0.0),
    "n1_rated": ("rad s-1", "rpm", "rotor speed at n1 = 1, right-handed about the thrust", -MOST),
    "n2_rated": ("rad s-1", "rpm", "rotor speed at n2 = 1, right-handed about the thrust", -MOST),
    "n1_inertia": ("kg m2", "kg m2", "moment of inertia of the n1 rotor", 0.0),
    "n2_inertia": ("kg m2", "kg m2", "moment of inertia of the n2 rotor", 0.0),
}
# Inputs that drive the engine: quantity of the vocabulary, description.
_DRIVES = {
    "thrust_drive": ("thrust", "net thrust that drives when mode.engine is 2"),
    "n1_drive": ("n1", "n1 that drives when mode.engine is 1"),
}
# Inputs that are 0 or 1.
_SWITCHES = ("cutoff", "starter", "ignition", "flameout")


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the items of the groups: numbers of the engines from 1, with or without spools.

    Raises
    ------
    SchemaError
        Some engines have a deck, and others do not.
    """
    numbers, without_deck = [], []
    for number, engine in enumerate(aircraft.engines, 1):
        numbers.append(str(number))
        if engine.deck is None:
            without_deck.append(str(number))
    if without_deck and len(without_deck) < len(numbers):
        raise SchemaError(
            aircraft.name,
            [
                f"engine {', '.join(without_deck)} has no deck and others have one; give every "
                f"engine one or none"
            ],
        )
    spools = () if without_deck else tuple(numbers)
    return {"engine": tuple(numbers), "spool": spools}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of a name of an engine."""
    word = name.rsplit(".", 1)[-1]
    engine = aircraft.engines[int(item) - 1]
    if word in _DRIVES:
        quantity, text = _DRIVES[word]
        return make_vocabulary_row(name, quantity, text)
    if kind == INPUT:
        low, high = aircraft.limits.get(word, (0.0, 1.0))
        if word in _SWITCHES:
            low, high = 0.0, 1.0
        return make_vocabulary_row(name, word, low=low, high=high)
    if kind in (OUTPUT, STATE, VARIABLE):
        return make_vocabulary_row(name, word)
    if word in _CONSTANTS:
        units, display_units, text, low = _CONSTANTS[word]
        # constants of the spools are those of the deck
        owner = engine if hasattr(engine, word) else engine.deck
        value = getattr(owner, word)
        return make_row(name, units, text, display_units=display_units, value=value, low=low)
    return _geometry_row(name, word, engine)


def _geometry_row(name: str, word: str, engine: Engine) -> CatalogueEntry:
    """Return the row of a component of direction, position or inlet."""
    axis = word.removesuffix("_inlet")[-1]
    index = "xyz".index(axis)
    if word.startswith("direction"):
        text = f"direction of the thrust, body {axis}"
        return make_row(name, "1", text, value=engine.direction[index], low=-1.0, high=1.0)
    position, force = engine.position, "thrust"
    if word.endswith("_inlet"):
        force = "ram drag"
        # the ram drag acts at the thrust if the deck does not give an inlet
        if engine.deck is not None and engine.deck.inlet is not None:
            position = engine.deck.inlet
    text = f"place of the {force} from the moment reference point, body {axis}"
    return make_row(name, "m", text, value=position[index])


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return the tables of thrust, of the decks, and of what turns and is a propeller."""
    for number, engine in enumerate(aircraft.engines, 1):
        own = OWN if engine.propeller is None else (*OWN, *SHAFT_VARIABLES)
        # variables of an engine have its number in the model: engine1.throttle
        names = {name: f"engine{number}.{name}" for name in own}
        for target, leaf in list_leaves(engine).items():
            renamed = _rename_variables(leaf, names)
            yield f"engine{number}.{target}", f"engine{number}/{target}", renamed


def _rename_variables(leaf: xr.Dataset, names: Mapping[str, str]) -> xr.Dataset:
    """Rename axes and regressors of a table."""
    axes = {name: new for name, new in names.items() if name in leaf.dims}
    regressors = [names.get(name, name) for name in list_regressors(leaf)]
    return leaf.rename(axes).assign_attrs(regressors=" ".join(regressors))
