"""Quantities that a column of a recording may be taken as, in groups for a list of choices."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain
from typing import Any

from aeromatch.drafting.name_map.name_rows import GROUPS
from flightmech.names import SIGNS, lookup
from flighttest.records.readers.channel_correction import recorder_units

# Quantities of the groups that the name map has without a fixed list of names.
_CONTROLS = (
    *("delta_e", "delta_a", "delta_a_left", "delta_a_right", "delta_r", "delta_f"),
    *("delta_f_left", "delta_f_right", "delta_t", "delta_ta", "delta_tr", "i_h", "delta_sp"),
    *("delta_s", "delta_d", "delta_nw", "gear", "speedbrake", "brake", "brake_left"),
    *("brake_right", "column", "wheel", "pedal", "F_column", "F_wheel", "F_pedal", "throttle"),
    *("stall_warning", "wow_nose", "wow_left", "wow_right"),
)
_OF_AN_ENGINE = (
    *("throttle", "pla", "n1", "n2", "fuel_flow", "thrust", "itt", "epr", "torque"),
    *("manifold_pressure", "rpm", "prop_command", "mixture", "cutoff"),
)


@dataclass(frozen=True)
class OfferedQuantity:
    """A quantity that a column may be taken as.

    Attributes
    ----------
    name, meaning : str
    units : tuple of str
        Units of recorders, the SI unit first.
    sign : str
        Direction of the positive sense; empty where the vocabulary states none.
    """

    name: str
    meaning: str
    units: tuple[str, ...]
    sign: str

    def to_dict(self) -> dict[str, Any]:
        """Return the quantity as plain data."""
        return {
            "name": self.name,
            "meaning": self.meaning,
            "units": list(self.units),
            "sign": self.sign,
        }


def offered_quantities(engines: int, known: Iterable[str] = ()) -> dict[str, list[OfferedQuantity]]:
    """Return the quantities of recordings by group.

    Parameters
    ----------
    engines : int
        Number of engines whose quantities are in the list.
    known : iterable of str
        Further names, such as those of a map that its author has written.
    """
    names = {group.replace("_", " "): list(members) for group, members in GROUPS.items()}
    names["controls"] = list(_CONTROLS)
    for number in range(1, engines + 1):
        names[f"engine {number}"] = [f"engine{number}.{name}" for name in _OF_AN_ENGINE]
    listed = set(chain.from_iterable(names.values()))
    others = [name for name in dict.fromkeys(known) if name not in listed]
    if others:
        names["other"] = others
    return {group: list(map(_describe, members)) for group, members in names.items()}


def _describe(name: str) -> OfferedQuantity:
    quantity = lookup(name)
    sense = SIGNS.get(quantity.sign, quantity.sign)
    return OfferedQuantity(name, quantity.long_name, recorder_units(name), sense)
