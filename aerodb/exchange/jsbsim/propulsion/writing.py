"""Export of propellers, piston engines and turboprops as files of JSBSim.

The inverse of `engines` and `propellers`: what was read is written with the same numbers.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import xarray as xr

from aerodb.exchange.jsbsim.propulsion.elements import (
    GAS_CONSTANT,
    HORSEPOWER,
    INHG,
    POUNDS_PER_KILOGRAM,
    STANDARD_PRESSURE,
    TORQUES,
    VOLUMES,
)
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.aircraft.propulsion.piston_engine import PistonEngine
from flightmech.aircraft.propulsion.propeller import Propeller
from flightmech.errors import SchemaError
from flightmech.support.atomic_write import folder_for_files, written_atomically
from flightmech.units import DEGREE, FOOT, INCH, KNOT, POUND, SLUG

_RPM = 2.0 * np.pi / 60.0  # [rad s-1]
# Stroke and piston speed that give the impedances their meaning in JSBSim; any would do.
_STROKE, _PEAK = 4.375 * INCH, 100.0 * FOOT
_RICHEST, _STOICHIOMETRIC = 1.3, 14.7
_OWN_GAS_CONSTANT = 287.05287  # [J kg-1 K-1]
_SAME = 1e-9
_PSF = POUND * 9.80665 / FOOT**2


def export_jsbsim_engine(engine: Engine, folder: Path, name: str) -> tuple[str, str]:
    """Write the files of an engine and of its propeller.

    Parameters
    ----------
    engine : Engine
        With a propeller, and a piston engine or a gas generator.
    folder : Path
        Folder of the files, ``Engines`` next to the aircraft file.
    name : str
        Beginning of the names of the files.

    Returns
    -------
    tuple of str
        Names of the engine file and of the propeller file, without ``.xml``.

    Raises
    ------
    SchemaError
        With all parts that JSBSim does not have, such as power from a chart.
    """
    assert engine.propeller is not None, "an engine without a propeller is an external force"
    problems = list_obstacles(engine)
    if problems:
        raise SchemaError(f"JSBSim engine {name}", problems)
    if engine.piston is not None:
        mover = _write_piston(engine.piston, engine.propeller, name)
    else:
        assert engine.deck is not None, "list_obstacles demands a piston engine or a deck"
        mover = _write_turboprop(engine.deck, engine.propeller, name)
    files = {f"{name}_engine": mover, f"{name}_propeller": _write_propeller(engine.propeller, name)}
    with folder_for_files(folder) as place:
        for file, root in files.items():
            ET.indent(root)
            with written_atomically(place / f"{file}.xml") as part:
                ET.ElementTree(root).write(part, encoding="utf-8", xml_declaration=True)
    engine_file, propeller_file = files
    return engine_file, propeller_file


def list_obstacles(engine: Engine) -> list[str]:
    """Return the parts of an engine with a propeller that JSBSim does not have."""
    problems = []
    blades = engine.propeller
    assert blades is not None, "an engine without a propeller is an external force"
    if engine.motor is not None:
        problems.append("an electric motor with a battery is not written")
    for name in sorted({"low_stop", "CN_prop"} & set(blades.tables)):
        problems.append(f"table {name} of the propeller: JSBSim has no form for it")
    for name in ("CT_prop", "CP_prop"):
        allowed = {"J", "blade_angle"}
        if set(map(str, blades.tables[name]["value"].dims)) - allowed:
            problems.append(f"{name} has axes beyond J and blade_angle")
    if engine.piston is not None:
        problems += _piston_obstacles(engine.piston)
    elif engine.deck is None:
        problems.append("shaft power without a piston engine or a gas generator")
    elif "shaft_power" not in blades.tables or "shaft_bsfc" not in blades.tables:
        problems.append("the turboprop needs the tables shaft_power and shaft_bsfc")
    return problems


def _piston_obstacles(piston: PistonEngine) -> list[str]:
    problems = []
    unknown = set(piston.tables) - {"fuel_work", "friction_pressure", "friction_power"}
    if unknown or "fuel_work" not in piston.tables:
        problems.append(
            "power from a chart: JSBSim has the work of the fuel, table fuel_work, "
            "friction_pressure and friction_power"
        )
    if (
        abs(piston.pumping - piston.volumetric_efficiency * GAS_CONSTANT / _OWN_GAS_CONSTANT)
        > _SAME
    ):
        problems.append("pumping is not the volumetric efficiency, which JSBSim uses for both")
    rich = _RICHEST / _STOICHIOMETRIC
    if piston.enrichment != 1.0 or abs(piston.full_rich - rich) > _SAME:
        problems.append(f"the mixture of JSBSim has enrichment 1 and full_rich {rich:.6f}")
    if piston.boost_ratio != 1.0:
        problems.append("a compressor is not written")
    return problems


def _write_propeller(propeller: Propeller, name: str) -> ET.Element:
    # JSBSim applies the gyroscopic moment -omega x H with this sign only from version 1.1 on.
    root = ET.Element("propeller", name=f"{name} propeller", version="1.1")
    _add(root, "ixx", propeller.inertia / (SLUG * FOOT**2), unit="SLUG*FT2")
    _add(root, "diameter", propeller.diameter / INCH, unit="IN")
    _add(root, "gearratio", propeller.gear_ratio)
    _add(root, "minpitch", propeller.low_pitch / DEGREE)
    _add(root, "maxpitch", propeller.highest / DEGREE)
    if propeller.turns_blades:
        _add(root, "minrpm", propeller.rpm_low / _RPM)
        _add(root, "maxrpm", propeller.rpm_high / _RPM)
        _add(root, "constspeed", int(bool(propeller.governed)))
    for table, target in (("C_THRUST", "CT_prop"), ("C_POWER", "CP_prop")):
        leaf = propeller.tables[target]
        _add_plane(root, table, leaf["value"], {"J": 1.0, "blade_angle": DEGREE})
    for table, target in (("CT_MACH", "CT_prop"), ("CP_MACH", "CP_prop")):
        if "K1" in propeller.tables[target]:
            _add_plane(root, table, propeller.tables[target]["K1"], {"tip_mach": 1.0})
    return root


def _write_piston(piston: PistonEngine, propeller: Propeller, name: str) -> ET.Element:
    root = ET.Element("piston_engine", name=name)
    # JSBSim has impedances per piston speed, the kernel per speed of the crankshaft:
    # mean piston speed = stroke omega / pi.
    travel = _STROKE / np.pi
    idle = piston.fire_rpm / 0.8
    airbox = piston.intake_impedance * _PEAK / travel
    closed = piston.throttle_impedance * _PEAK / travel
    low_map = STANDARD_PRESSURE / (1.0 + (closed + airbox) * idle * travel / _PEAK)
    work = piston.tables["fuel_work"]["value"]
    # JSBSim takes the work of the fuel at best mixture as bsfc, and the rest as a table.
    most = float(work.max())
    _add(root, "minmp", low_map / INHG, unit="INHG")
    _add(root, "displacement", piston.displacement / VOLUMES["IN3"], unit="IN3")
    _add(root, "bsfc", POUNDS_PER_KILOGRAM * 3600.0 * HORSEPOWER / most)
    _add(root, "cycles", 4)
    _add(root, "idlerpm", idle / _RPM)
    _add(root, "maxrpm", propeller.rpm_high * propeller.gear_ratio / _RPM)
    _add(root, "stroke", _STROKE / INCH, unit="IN")
    _add(root, "peak-piston-speed", _PEAK / FOOT)
    _add(root, "air-intake-impedance-factor", airbox)
    _add(root, "ram-air-factor", piston.ram_recovery)
    _add(root, "man-press-lag", piston.map_time)
    _add(root, "volumetric-efficiency", piston.pumping)
    _add(root, "compression-ratio", piston.compression_ratio)
    _add(root, "starter-torque", piston.crank_torque / TORQUES["FT*LB"])
    _add(root, "starter-rpm", piston.crank_rpm / _RPM)
    static, slope = _line_of(piston.tables.get("friction_pressure"))
    _add(root, "dynamic-fmep", slope / travel, unit="PA")
    _add(root, "static-fmep", static, unit="PA")
    friction, _ = _line_of(piston.tables.get("friction_power"))
    _add(root, "static-friction", friction / HORSEPOWER, unit="HP")
    _add_plane(root, "MIXTURE", work / most, {"fuel_air_ratio": 1.0})
    return root


def _line_of(leaf: xr.Dataset | None) -> tuple[float, float]:
    """Return value at zero and slope of a table over the speed of the engine; its first cell."""
    if leaf is None:
        return 0.0, 0.0
    value = leaf["value"]
    if "engine_rpm" not in value.dims:
        return float(value), 0.0
    # JSBSim takes a straight line: that through the first two points.
    points = value["engine_rpm"].values
    slope = float((value[1] - value[0]) / (points[1] - points[0]))
    return float(value[0]) - slope * float(points[0]), slope


def _write_turboprop(deck: EngineDeck, propeller: Propeller, name: str) -> ET.Element:
    root = ET.Element("turboprop_engine", name=name)
    command = deck.tables["n1_command"]["value"].values
    power, consumption = propeller.tables["shaft_power"], propeller.tables["shaft_bsfc"]["value"]
    _add(root, "idlen1", 100.0 * float(command.min()))
    _add(root, "maxn1", 100.0 * float(command.max()))
    _add(root, "maxpower", propeller.power_limit / HORSEPOWER, unit="HP")
    # the specific consumption at the highest N1; the table has that of the others
    specific = float(consumption[-1])
    _add(root, "psfc", specific * 3600.0 * HORSEPOWER / POUND, unit="LBS/HR/HP")
    _add(root, "n1idle_max_delay", float(deck.tables["n1_up_time"]["value"]))
    _add(root, "startern1", 100.0 * deck.starter_speed)
    _add(root, "itt_delay", deck.itt_time)
    if propeller.torque_limit < 1e12:
        _add(root, "ielumaxtorque", propeller.torque_limit / TORQUES["FT*LB"], unit="FT*LB")
    if "K1" in power:
        table = _add_plane(
            root,
            "EnginePowerVC",
            power["K1"],
            {"pressure_ratio": _PSF / 101325.0, "V_eas": KNOT},
        )
        for place, (lookup, text) in enumerate(
            (("row", "atmosphere/P-psf"), ("column", "velocities/ve-kts"))
        ):
            variable = ET.Element("independentVar", lookup=lookup)
            variable.text = text
            table.insert(place, variable)
    in_horsepower = power["value"] / HORSEPOWER
    _add_plane(root, "EnginePowerRPM_N1", in_horsepower, {"engine_rpm": _RPM, "n1": 0.01})
    _add_plane(root, "CombustionEfficiency_N1", specific / consumption, {"n1": 0.01})
    itt = deck.tables["itt"]["value"] - 273.15
    both = xr.concat([itt, itt], xr.Variable("running", [0.0, 1.0])).transpose("n1", "running")
    _add_plane(root, "ITT_N1", both, {"n1": 0.01, "running": 1.0})
    return root


def _add(parent: ET.Element, tag: str, value: float, unit: str = "") -> None:
    attributes = {"unit": unit} if unit else {}
    ET.SubElement(parent, tag, attributes).text = repr(value)


def _add_plane(
    parent: ET.Element, name: str, table: xr.DataArray, scales: dict[str, float]
) -> ET.Element:
    """Add a table over one or two variables; `scales` are their units [SI], rows first."""
    element = ET.SubElement(parent, "table", name=name, type="internal")
    order = [axis for axis in scales if axis in table.dims]
    values = table.transpose(*order).values
    points = [table[axis].values / scales[axis] for axis in order]
    rows = []
    if len(order) == 2:
        rows.append(_row_text(points[1]))
    for point, row in zip(points[0], values, strict=True):
        rows.append(_row_text(np.concatenate([[point], np.atleast_1d(row)])))
    ET.SubElement(element, "tableData").text = "\n" + "\n".join(rows) + "\n"
    return element


def _row_text(numbers: np.ndarray) -> str:
    return " ".join(repr(float(number)) for number in numbers)
