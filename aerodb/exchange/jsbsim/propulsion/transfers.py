"""Transfer pumps of an aircraft as functions of a JSBSim flight control.

JSBSim has no pump.  It has an external flow into each tank, which functions set in each step.
"""

from __future__ import annotations

import warnings
from xml.etree import ElementTree as ET

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.propulsion.fuel_transfer import Transfer
from flightmech.errors import AeromatchWarning
from flightmech.units import POUND


def crossfeed_problems(number: int, engine: Engine) -> list[str]:
    """Return the problem of an engine that a cross-feed reaches; `number` from 1."""
    if not engine.crossfeed:
        return []
    return [
        f"engine {number}: the cross-feed from {', '.join(engine.crossfeed)} has no form in "
        f"JSBSim, whose engines draw from the same tanks all the time; delete crossfeed from the "
        f"engine, as with the valve shut, or write an FMU, which has it"
    ]


def warn_of_lost_tanks(aircraft: Aircraft) -> None:
    """Warn of tanks of an aircraft whose engines are external forces: no fuel burns or moves."""
    if aircraft.fuel is None or not aircraft.fuel.tanks:
        return
    names = ", ".join(tank.name for tank in aircraft.fuel.tanks)
    warnings.warn(
        f"tanks {names}: engines without propellers are forces in the JSBSim file, which burn no "
        f"fuel; the contents are a constant part of the mass, and feeds, cross-feeds and pumps are "
        f"not written; write an FMU, which has them",
        AeromatchWarning,
        stacklevel=3,
    )


def write_transfers(control: ET.Element, fuel: Fuel) -> None:
    """Write the pumps as a channel of the flight control.

    ``fcs/transfer-tip-left-on`` (0 or 1) switches the pump from tank tip to tank left, and
    ``fcs/transfer-tip-left-pps`` is its flow. [lb/s]
    """
    for transfer in fuel.transfers:
        switch = ET.SubElement(control, "property", value="1" if transfer.on else "0")
        switch.text = f"{_name(transfer)}-on"
    channel = ET.SubElement(control, "channel", name="Transfers")
    names = [tank.name for tank in fuel.tanks]
    for transfer in fuel.transfers:
        source, target = names.index(transfer.source), names.index(transfer.target)
        _write_flow(channel, transfer, _contents(source), _contents(target))
    for index, name in enumerate(names):
        into = [f"{_name(pump)}-pps" for pump in fuel.transfers if pump.target == name]
        out = [f"{_name(pump)}-pps" for pump in fuel.transfers if pump.source == name]
        if into or out:
            _write_balance(channel, index, into, out)


def _name(transfer: Transfer) -> str:
    return f"fcs/transfer-{transfer.source}-{transfer.target}"


def _contents(index: int) -> str:
    return f"propulsion/tank[{index}]/contents-lbs"


def _write_flow(channel: ET.Element, transfer: Transfer, source: str, target: str) -> None:
    """Write on * rate * max(0, min(1, (source - leave)/band, (fill - target)/band))."""
    component = ET.SubElement(channel, "fcs_function", name=f"{_name(transfer)}-flow")
    product = ET.SubElement(ET.SubElement(component, "function"), "product")
    _add(product, "property", f"{_name(transfer)}-on")
    _add(product, "value", repr(transfer.rate / POUND))
    positive = ET.SubElement(product, "max")
    _add(positive, "value", "0")
    least = ET.SubElement(positive, "min")
    _add(least, "value", "1")
    for first, second in (
        (("property", source), ("value", repr(transfer.leave / POUND))),
        (("value", repr(transfer.fill / POUND)), ("property", target)),
    ):
        quotient = ET.SubElement(least, "quotient")
        difference = ET.SubElement(quotient, "difference")
        _add(difference, *first)
        _add(difference, *second)
        _add(quotient, "value", repr(transfer.band / POUND))
    _add(component, "output", f"{_name(transfer)}-pps")


def _write_balance(channel: ET.Element, index: int, into: list[str], out: list[str]) -> None:
    """Write what the pumps move into a tank, less what they move out of it."""
    component = ET.SubElement(channel, "fcs_function", name=f"fcs/transfers-of-tank{index}")
    difference = ET.SubElement(ET.SubElement(component, "function"), "difference")
    for flows in (into, out):
        total = ET.SubElement(difference, "sum")
        # a sum has at least one term
        _add(total, "value", "0")
        for flow in flows:
            _add(total, "property", flow)
    _add(component, "output", f"propulsion/tank[{index}]/external-flow-rate-pps")


def _add(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = text
