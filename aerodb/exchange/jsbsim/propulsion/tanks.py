"""Tanks of a JSBSim aircraft file that feed engines, read and written.

JSBSim draws equal shares from the tanks of the lowest ``<priority>`` that feed an engine and hold
fuel.  It has no cross-feed valve.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np

from aerodb.exchange.jsbsim.metrics import LENGTH_UNITS, MASS_UNITS, unit_of_element
from aerodb.exchange.jsbsim.propulsion.pump_reading import pumped_tanks, read_transfers
from aerodb.exchange.xml_reader import Element
from flightmech.aircraft.aircraft import Aircraft, with_contents
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.fuel import Fuel, check_feeds
from flightmech.aircraft.propulsion.tank import Tank
from flightmech.errors import SchemaError

_PARTS = ("location", "capacity", "contents")


def read_fed_tanks(
    root: Element, engines: tuple[Engine, ...], reference: np.ndarray
) -> tuple[Fuel | None, tuple[Engine, ...], list[str]]:
    """Return the fuel in tanks that feed engines, the engines with their feeds, and remarks.

    Parameters
    ----------
    root : Element
        ``<fdm_config>``.
    engines : tuple of Engine
        Engines that were read from it, in the order of the file.
    reference : array (3,)
        Moment reference point from the drawing datum, body axes. [m]

    Returns
    -------
    fuel : Fuel or None
        None, if a tank that feeds an engine is incomplete, an engine has no feed, or the tanks are
        empty.  A remark states why, and the fuel then is a part of the mass that stays.
    engines : tuple of Engine
    remarks : list of str
    """
    if not engines:
        return None, engines, []
    propulsion = root.need("propulsion")
    tanks = propulsion.all("tank")
    feeds = []
    for element in propulsion.all("engine"):
        feeds.append([int(feed.number) for feed in element.all("feed")])
    reason = _find_obstacle(tanks, feeds)
    if reason:
        return None, engines, [f"fuel is a mass that stays: {reason}"]
    names = _name_tanks(tanks)
    # a pump may empty a tank that feeds no engine
    pumped = {index for index in pumped_tanks(root) if _is_complete(tanks, index)}
    used = sorted(pumped.union(*feeds))
    read = {index: _read_tank(tanks[index], names[index], reference) for index in used}
    fed = []
    for engine, feed in zip(engines, feeds, strict=True):
        # a tank that is named twice feeds once
        fed.append(replace(engine, feed=tuple(dict.fromkeys(names[index] for index in feed))))
    try:
        mass = sum(tank.content for tank in read.values())
        transfers, pump_remarks = read_transfers(root, list(read.values()))
        fuel = Fuel(mass, tanks=tuple(read.values()), transfers=transfers)
        problems = check_feeds(fed, fuel)
    except SchemaError as error:
        problems = list(error.problems)
    if problems:
        return None, engines, [f"fuel is a mass that stays: {problems[0]}"]
    return fuel, tuple(fed), [*_remarks(fed, fuel), *pump_remarks]


def _find_obstacle(tanks: Sequence[Element], feeds: Sequence[Sequence[int]]) -> str:
    """Return why the tanks are not read, empty if they are."""
    contents = 0.0
    for number, feed in enumerate(feeds, 1):
        if not feed:
            return f"engine {number} has no <feed>"
        for index in feed:
            if not 0 <= index < len(tanks):
                return f"engine {number} is fed from tank {index} of {len(tanks)}"
            missing = [name for name in _PARTS if tanks[index].first(name) is None]
            if missing:
                return f"tank {index} has no <{missing[0]}>"
            priority = tanks[index].first("priority")
            if priority is not None and priority.number < 1.0:
                return f"tank {index} is not selected, its <priority> is {priority.number:g}"
            contents += tanks[index].need("contents").number
    return "" if contents > 0.0 else "the tanks are empty"


def _is_complete(tanks: Sequence[Element], index: int) -> bool:
    """Return whether a tank is in the file, with place, capacity and contents."""
    if not 0 <= index < len(tanks):
        return False
    return all(tanks[index].first(name) is not None for name in _PARTS)


def _name_tanks(tanks: Sequence[Element]) -> list[str]:
    """Return the names of the tanks: tank0, tank1 ... by their numbers in JSBSim."""
    return [f"tank{index}" for index in range(len(tanks))]


def _read_tank(element: Element, name: str, reference: np.ndarray) -> Tank:
    location, priority = element.need("location"), element.first("priority")
    scale = unit_of_element(location, "IN", LENGTH_UNITS)
    # structural axes have x aft and z up
    place = [
        sign * location.need(axis).number * scale
        for axis, sign in zip("xyz", (-1.0, 1.0, -1.0), strict=True)
    ]
    x, y, z = (float(value) for value in np.array(place) - reference)
    masses = []
    for key in ("contents", "capacity"):
        part = element.need(key)
        masses.append(part.number * unit_of_element(part, "LBS", MASS_UNITS))
    order = 1 if priority is None else int(priority.number)
    # JSBSim starts with a tank at most full
    content = min(masses)
    return Tank((x, y, z), masses[1], order, name=name, content=content)


def _remarks(engines: Sequence[Engine], fuel: Fuel) -> Iterator[str]:
    """Yield in what the feeds differ from those of JSBSim."""
    tanks = {tank.name: tank for tank in fuel.tanks}
    for engine in engines:
        for order in {tanks[name].order for name in engine.feed}:
            sizes = {tanks[name].capacity for name in engine.feed if tanks[name].order == order}
            if len(sizes) > 1:
                yield (
                    "tanks of one priority give fuel in proportion to their capacity, in JSBSim "
                    "equal shares"
                )
                return


def without_fuel(aircraft: Aircraft) -> Aircraft:
    """Return the aircraft with its tanks empty: mass, c.g. and inertia about it."""
    assert aircraft.fuel is not None, "only aircraft with tanks are emptied"
    empty = with_contents(aircraft, {tank.name: 0.0 for tank in aircraft.fuel.tanks})
    return replace(empty, fuel=None)


def write_feeds(element: ET.Element, engine: Engine, fuel: Fuel) -> None:
    """Write the tanks that feed an engine; JSBSim has no cross-feed."""
    names = [tank.name for tank in fuel.tanks]
    for name in engine.feed:
        ET.SubElement(element, "feed").text = str(names.index(name))


def list_priorities(fuel: Fuel) -> list[int]:
    """Return the priorities of the tanks: 1 for the lowest order, without gaps."""
    orders = sorted({tank.order for tank in fuel.tanks})
    return [orders.index(tank.order) + 1 for tank in fuel.tanks]
