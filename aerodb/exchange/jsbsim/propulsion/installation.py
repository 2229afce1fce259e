"""Engines of a JSBSim aircraft file: what turns which propeller, and where."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from aerodb.exchange.jsbsim.metrics import LENGTH_UNITS, unit_of_element
from aerodb.exchange.jsbsim.propulsion.engines import import_jsbsim_engine
from aerodb.exchange.jsbsim.propulsion.propellers import import_jsbsim_propeller, shift_of_inches
from aerodb.exchange.xml_reader import Element, read_xml
from flightmech.aircraft.engine import Engine
from flightmech.errors import AeromatchError
from flightmech.units import DEGREE

# Folders in which JSBSim looks for engine files, from the folder of the aircraft.
_FOLDERS = ("Engines", "engines", ".", "../../engine", "../engine")
_ANGLES = {"DEG": DEGREE, "RAD": 1.0}
_SHAFT = ("piston_engine", "turboprop_engine")


def read_engines(root: Element, reference: np.ndarray) -> tuple[tuple[Engine, ...], list[str]]:
    """Return the engines with propellers of an aircraft file, and remarks.

    Parameters
    ----------
    root : Element
        ``<fdm_config>``.
    reference : array (3,)
        Moment reference point from the drawing datum, body axes. [m]

    Returns
    -------
    engines : tuple of Engine
        Empty if one of the engines is of another kind, or a file is missing: engines of one
        aircraft are of one kind.  A remark states why.
    remarks : list of str
    """
    propulsion = root.first("propulsion")
    if propulsion is None:
        return (), []
    engines: list[Engine] = []
    remarks: list[str] = []
    folder = Path(root.file).parent
    for element in propulsion.all("engine"):
        reason = _find_obstacle(element, folder)
        if reason:
            return (), [reason]
        try:
            engine, engine_remarks = _read_engine(element, folder, reference)
        except AeromatchError as error:
            return (), [f"engines are not read: {error}"]
        engines.append(engine)
        remarks += [text for text in engine_remarks if text not in remarks]
    return tuple(engines), remarks


def _find_obstacle(element: Element, folder: Path) -> str:
    """Return why an engine is not read, such as a missing file; empty for one that is read."""
    name = element.attributes.get("file", "")
    thruster = element.first("thruster")
    if not name or thruster is None or not thruster.attributes.get("file"):
        return "engines are not read: they are not in files of their own"
    file = _find_file(folder, name)
    if file is None:
        return f"engines are not read: no file {name}.xml in {', '.join(_FOLDERS)} of the aircraft"
    kind = read_xml(file).tag
    if kind not in _SHAFT:
        return f"engines are not read: {file.name} is a <{kind}>"
    propeller = thruster.attributes["file"]
    propeller_file = _find_file(folder, propeller)
    if propeller_file is None:
        folders = ", ".join(_FOLDERS)
        return f"engines are not read: no file {propeller}.xml in {folders} of the aircraft"
    kind = read_xml(propeller_file).tag
    if kind != "propeller":
        return f"engines are not read: {propeller_file.name} is a <{kind}>"
    return ""


def _find_file(folder: Path, name: str) -> Path | None:
    """Return the first file of a name that JSBSim would find."""
    # a name is not a path: a file cannot lead out of these folders
    if Path(name).name != name:
        return None
    for place in _FOLDERS:
        file = folder / place / f"{name.removesuffix('.xml')}.xml"
        if file.is_file():
            return file
    return None


def _read_engine(element: Element, folder: Path, reference: np.ndarray) -> tuple[Engine, list[str]]:
    """Return an engine with its propeller, and remarks, after `_find_obstacle` found none."""
    thruster = element.need("thruster")
    engine_file = _find_file(folder, element.attribute("file"))
    propeller_file = _find_file(folder, thruster.attribute("file"))
    assert engine_file is not None
    assert propeller_file is not None
    shaft_engine = import_jsbsim_engine(engine_file)
    # A negative sense turns the propeller to the left, seen from behind.
    sense, p_factor = thruster.first("sense"), thruster.first("p_factor")
    is_left_handed = sense is not None and sense.number < 0.0
    propeller, remarks = import_jsbsim_propeller(
        propeller_file,
        rotation=-1 if is_left_handed else 1,
        p_factor=shift_of_inches(p_factor.number) if p_factor is not None else 0.0,
        engine_rpm=shaft_engine.rated_rpm,
    )
    # The thrust acts where the thruster is, or where the engine is.
    location = thruster.first("location") or element.first("location")
    position = np.zeros(3)
    if location is not None:
        position = _read_position(location) - reference
    orient = thruster.first("orient") or element.first("orient")
    x, y, z = map(float, position)
    engine = Engine(
        (x, y, z),
        _read_direction(orient),
        propeller=shaft_engine.on(propeller),
        piston=shaft_engine.piston,
        deck=shaft_engine.deck,
    )
    return engine, remarks + shaft_engine.remarks


def _read_position(location: Element) -> np.ndarray:
    """Return a point in structural axes, x aft and z up, along body axes. [m]"""
    scale = unit_of_element(location, "IN", LENGTH_UNITS)
    signs = {"x": -1.0, "y": 1.0, "z": -1.0}
    return np.array([sign * location.need(axis).number * scale for axis, sign in signs.items()])


def _read_direction(orient: Element | None) -> tuple[float, float, float]:
    """Return the direction of the thrust, body axes: pitch up, yaw right."""
    angles = {"pitch": 0.0, "yaw": 0.0}
    if orient is not None:
        scale = unit_of_element(orient, "RAD", _ANGLES)
        for name in angles:
            child = orient.first(name)
            if child is not None:
                angles[name] = child.number * scale
    pitch, yaw = angles["pitch"], angles["yaw"]
    return (
        float(np.cos(pitch) * np.cos(yaw)),
        float(np.cos(pitch) * np.sin(yaw)),
        float(-np.sin(pitch)),
    )
