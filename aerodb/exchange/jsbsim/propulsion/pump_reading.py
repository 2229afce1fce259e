"""Transfer pumps of a JSBSim aircraft file: those that the export writes, read again.

JSBSim has an external flow into each tank, which any function may set.  A function of the form of
`aerodb.exchange.jsbsim.propulsion.transfers` is a pump; any other is remarked and not read.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from aerodb.exchange.xml_reader import Element
from flightmech.aircraft.propulsion.fuel_transfer import Transfer
from flightmech.aircraft.propulsion.tank import Tank
from flightmech.units import POUND

_FLOW = "external-flow-rate-pps"
_CONTENTS = re.compile(r"propulsion/tank\[(\d+)\]/contents-lbs")
# Part of a capacity within which the level of a float valve is the full tank.
_ROUNDING = 1e-9


def pumped_tanks(root: Element) -> set[int]:
    """Return the numbers of the tanks that a pump empties or fills."""
    numbers: set[int] = set()
    for flow in _list_pumps(root):
        numbers |= set(_tanks_of(flow))
    return numbers


def read_transfers(root: Element, tanks: Sequence[Tank]) -> tuple[tuple[Transfer, ...], list[str]]:
    """Return the pumps of a file, and remarks on flows of another form.

    Parameters
    ----------
    root : Element
        ``<fdm_config>``.
    tanks : sequence of Tank
        Tanks that were read, with the names ``tank0``, ``tank1`` ... of their numbers.
    """
    switches = {}
    for element in root.walk():
        if element.tag == "property" and "value" in element.attributes:
            switches[element.text] = element.attributes["value"].strip()
    capacities = {tank.name: tank.capacity for tank in tanks}
    pumps, flows = [], set[str]()
    for flow in _list_pumps(root):
        pump = _read_pump(flow, switches, capacities)
        # a pump of tanks that are not read moves nothing here
        if pump is not None:
            pumps.append(pump)
            flows.add(flow.need("output").text)
    return tuple(pumps), list(_describe_others(root, flows))


def _list_pumps(root: Element) -> Iterator[Element]:
    """Yield the functions that have the form of a written pump."""
    for element in root.walk():
        if element.tag == "fcs_function" and element.first("output") and _has_form(element):
            yield element


def _has_form(flow: Element) -> bool:
    """Return whether a function is on * rate * max(0, min(1, q, q)) of the contents of tanks."""
    shape = [element.tag for element in flow.walk()]
    quotient = ["quotient", "difference"]
    expected = ["fcs_function", "function", "product", "property", "value", "max", "value", "min"]
    expected += ["value", *quotient, "property", "value", "value"]
    expected += [*quotient, "value", "property", "value", "output"]
    return shape == expected and len(_tanks_of(flow)) == 2


def _tanks_of(flow: Element) -> list[int]:
    """Return the numbers of the source and of the target."""
    texts = [element.text for element in flow.walk() if element.tag == "property"]
    found = (_CONTENTS.fullmatch(text) for text in texts)
    return [int(match.group(1)) for match in found if match]


def _read_pump(
    flow: Element, switches: dict[str, str], capacities: dict[str, float]
) -> Transfer | None:
    """Return the pump of a function; None if a tank is not read."""
    source, target = (f"tank{number}" for number in _tanks_of(flow))
    if not {source, target} <= capacities.keys():
        return None
    switch = next(element.text for element in flow.walk() if element.tag == "property")
    values = [element.number * POUND for element in flow.walk() if element.tag == "value"]
    # rate, 0, 1, then level and band of each quotient
    rate, _, _, leave, band, fill, _ = values
    # a level in pounds is the capacity within the rounding of the unit
    if abs(fill - capacities[target]) <= _ROUNDING * capacities[target]:
        fill = capacities[target]
    on = switches.get(switch, "0") not in ("0", "0.0", "")
    return Transfer(source, target, rate, fill=fill, band=band, leave=leave, on=on)


def _describe_others(root: Element, flows: set[str]) -> Iterator[str]:
    """Yield a remark on each function that sets the flow of a tank and is not a sum of pumps."""
    for element in root.walk():
        output = element.first("output")
        if output is None or not output.text.endswith(_FLOW):
            continue
        used = {part.text for part in element.walk() if part.tag == "property"}
        if not used or not used <= flows:
            yield (
                f"line {element.line}: the function of {output.text} is not read, so that no fuel "
                f"is pumped by it"
            )
