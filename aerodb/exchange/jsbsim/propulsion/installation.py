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
            engine, own = _read_engine(element, folder, reference)
        except AeromatchError as error:
            return (), [f"engines are not read: {error}"]
        engines.append(engine)
        remarks += [text for text in own if text not in remarks]
    return tuple(engines), remarks


def _find_obstacle(element: Element, folder: Path) -> str:
    """Return why an engine is not read: no propeller, a file that does not exist; or an empty text."""
    name = element.attributes.get("file", "")
    thruster = element.first("thruster")
    if not name or thruster is None or not thruster.attributes.get("file"):
        return "engines are not read: they are not in files of their own"
    file = _find_file(folder, name)
    if file is None:
        return f"engines are not read: no file {name}.xml in {', '.join(_FOLDERS)} of the aircraft"
    if read_xml(file).tag not in _SHAFT:
        return f"engines are not read: {file.name} is a <{read_xml(file).tag}>"
    blades = thruster.attributes["file"]
    found = _find_file(folder, blades)
    if found is None:
        return (
            f"engines are not read: no file {blades}.xml in {', '.join(_FOLDERS)} of the aircraft"
        )
    return "" if read_xml(found).tag == "propeller" else f"engines are not read: {found.name}"


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
    thruster = element.need("thruster")
    engine_file = _find_file(folder, element.attribute("file"))
    propeller_file = _find_file(folder, thruster.attribute("file"))
    assert engine_file is not None, "_find_obstacle has found it"
    assert propeller_file is not None, "_find_obstacle has found it"
    mover = import_jsbsim_engine(engine_file)
    sense, shift = thruster.first("sense"), thruster.first("p_factor")
    propeller, remarks = import_jsbsim_propeller(
        propeller_file,
        rotation=-1 if sense is not None and sense.number < 0.0 else 1,
        p_factor=0.0 if shift is None else shift_of_inches(shift.number),
        engine_rpm=mover.rated_rpm,
    )
    # the thrust acts where the thruster is, or where the engine is
    place = thruster.first("location") or element.first("location")
    position = np.zeros(3) if place is None else _read_place(place) - reference
    orient = thruster.first("orient") or element.first("orient")
    x, y, z = map(float, position)
    engine = Engine(
        (x, y, z),
        _read_direction(orient),
        propeller=mover.on(propeller),
        piston=mover.piston,
        deck=mover.deck,
    )
    return engine, remarks + mover.remarks


def _read_place(location: Element) -> np.ndarray:
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
