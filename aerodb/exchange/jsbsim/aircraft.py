"""Import of geometry, mass, centre of gravity and inertia from a JSBSim aircraft file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from aerodb.exchange.jsbsim.metrics import (
    LENGTH_UNITS,
    MASS_UNITS,
    read_reference,
    read_section,
    read_sizes,
    unit_of_element,
)
from aerodb.exchange.jsbsim.propulsion.installation import read_engines
from aerodb.exchange.jsbsim.propulsion.tanks import read_fed_tanks
from aerodb.exchange.xml_reader import Element, read_xml
from flightmech.aircraft.aircraft import Aircraft, inertia_fields, point_inertia
from flightmech.units import FOOT, SLUG

_INERTIA = {"SLUG*FT2": SLUG * FOOT**2, "KG*M2": 1.0}
_SPHERE = 0.4  # inertia of a solid sphere over m r^2
# Inertia over m r^2 by the shape of a point mass: solid and hollow sphere, about any axis;
_ROUND = {"ball": _SPHERE, "sphere": 2.0 / 3.0}
# solid and hollow cylinder, about the axis of the cylinder.
_LONG = {"cylinder": 0.5, "tube": 1.0}


class _PointMass(NamedTuple):
    """A mass [kg], its position from the drawing datum along body axes [m], its inertia [kg m2].

    The inertia is about its own centre and the body axes x, y, z.
    """

    mass: float
    position: np.ndarray
    inertia: tuple[float, float, float] = (0.0, 0.0, 0.0)


def import_jsbsim_aircraft(
    path: str | os.PathLike[str], *, name: str = "", x_ref_mac: float = 0.25
) -> Aircraft:
    """Read the aircraft of the aerodynamics of a JSBSim file.

    Parameters
    ----------
    path : path
        The aircraft file.
    name : str
        Name of the aircraft.  The default is the name in the file.
    x_ref_mac : float
        Distance of ``AERORP`` behind the leading edge of the mean chord, which JSBSim does not
        state. [chords]

    Returns
    -------
    Aircraft
        Reference quantities, moment reference ``AERORP``, mass, c.g. and inertia of the empty
        aircraft with its point masses and the contents of its tanks, as JSBSim starts.  Piston
        engines and turboprops are read with their propellers, if all engines are such and their
        files are in the folders of JSBSim; the tanks that feed them then have a state each,
        ``tank0`` and so on by their numbers in JSBSim.  Other engines, landing gear and travel of
        the controls are not read, because JSBSim has them in other forms.  The history states so.

    Raises
    ------
    ParseError
        The file is not an aircraft file, or mass or inertia are missing, or it has an unknown unit,
        point masses with an extent, or gas cells; with the line.
    """
    path = Path(path)
    root = read_xml(path)
    if root.tag != "fdm_config":
        raise root.error(f"<{root.tag}>", "an aircraft file of JSBSim, <fdm_config>")
    gas = root.first("buoyant_forces")
    if gas is not None:
        raise gas.error(
            "<buoyant_forces>",
            "an aircraft without gas cells; the mass and inertia of the gas are not read",
        )
    metrics, balance = read_section(root, "metrics"), read_section(root, "mass_balance")
    sizes, reference = read_sizes(metrics), read_reference(metrics)
    datum = np.array([reference[f"{axis}_ref"] for axis in "xyz"])
    empty = _read_empty(balance)
    points = [*_read_point_masses(balance), *_read_tanks(root)]

    # Centre of gravity of all masses, then inertia about it.
    mass = empty.mass + sum(point.mass for point in points)
    moments = sum((point.mass * point.position for point in points), np.zeros(3))
    cg = (empty.mass * empty.position + moments) / mass
    parallel = sum((_inertia_about(point, cg) for point in (empty, *points)), np.zeros((3, 3)))
    J = _read_inertia(balance) + parallel
    engines, remarks = read_engines(root, datum)
    fuel, engines, fuel_remarks = read_fed_tanks(root, engines, datum)
    unread = "landing gear and limits of the controls are not read"
    if not engines and not remarks:
        unread = f"engines, {unread}"
    notes = "; ".join([f"{len(points)} point masses and tanks", *remarks, *fuel_remarks, unread])
    return Aircraft(
        name or root.attributes.get("name", "") or path.stem,
        S=sizes["S"],
        cbar=sizes["cbar"],
        b=sizes["b"],
        mass=float(mass),
        **inertia_fields(J),
        reference=(float(datum[0]), float(datum[1]), float(datum[2])),
        x_ref_mac=x_ref_mac,
        cg=tuple(map(float, cg - datum)),  # type: ignore[arg-type]
        engines=engines,
        fuel=fuel,
        history=f"import_jsbsim_aircraft: {path.name}, {notes}",
    )


def _read_inertia(balance: Element) -> np.ndarray:
    """Return the inertia tensor (3, 3) of the empty aircraft about its c.g., body axes. [kg m2]"""
    products = {}
    for key in ("ixy", "ixz", "iyz"):
        element = balance.first(key)
        products[key] = 0.0
        if element is not None:
            products[key] = _read_number(element, _INERTIA, "SLUG*FT2")
    keys = ("ixx", "iyy", "izz")
    if balance.first("emptywt", *keys) is None:
        # The point masses are the whole aircraft.
        return np.zeros((3, 3))
    xx, yy, zz = (_read_number(balance.need(key), _INERTIA, "SLUG*FT2") for key in keys)
    # Structural axes have x aft and z up. The reversal of one of them changes the sign of a
    # product, the reversal of both does not.
    is_negated = balance.attributes.get("negated_crossproduct_inertia", "true") == "true"
    sign = -1.0 if is_negated else 1.0
    xy, xz, yz = sign * products["ixy"], -sign * products["ixz"], sign * products["iyz"]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _read_empty(balance: Element) -> _PointMass:
    """Return the empty aircraft; without a mass, if the point masses are the whole aircraft."""
    element = balance.first("emptywt")
    if element is None and balance.all("pointmass"):
        return _PointMass(0.0, np.zeros(3))
    mass = _read_number(balance.need("emptywt"), MASS_UNITS, "LBS")
    return _PointMass(mass, _read_position(_find_cg(balance)))


def _find_cg(balance: Element) -> Element:
    for location in balance.all("location"):
        if location.attributes.get("name") == "CG":
            return location
    raise balance.error(
        "no location CG", "the centre of gravity of the empty aircraft, <location name='CG'>"
    )


def _read_point_masses(balance: Element) -> Iterator[_PointMass]:
    for element in balance.all("pointmass"):
        mass = _read_number(element.need("weight"), MASS_UNITS, "LBS")
        form = element.first("form")
        inertia = (0.0, 0.0, 0.0) if form is None else _form_inertia(form, mass)
        yield _PointMass(mass, _read_position(element.need("location")), inertia)


def _form_inertia(form: Element, mass: float) -> tuple[float, float, float]:
    """Return the inertia of a body about its centre and the body axes. [kg m2]"""
    shape = form.attributes.get("shape", "")
    if shape not in (*_ROUND, *_LONG):
        raise form.error(
            f"shape {shape!r} of a point mass", f"one of {', '.join((*_ROUND, *_LONG))}"
        )
    radius = _read_number(form.need("radius"), LENGTH_UNITS, "FT")
    if shape in _ROUND:
        inertia = _ROUND[shape] * mass * radius**2
        return inertia, inertia, inertia
    # The axis of a tube or cylinder is the body axis x: Iyy = Ixx / 2 + m l^2 / 12.
    length = _read_number(form.need("length"), LENGTH_UNITS, "FT")
    along = _LONG[shape] * mass * radius**2
    across = 0.5 * along + mass * length**2 / 12.0
    return along, across, across


def _read_tanks(root: Element) -> Iterator[_PointMass]:
    """Yield the contents of the tanks."""
    if root.first("propulsion") is None:
        return
    for element in read_section(root, "propulsion").all("tank"):
        contents, location = element.first("contents"), element.first("location")
        if contents is not None and location is not None:
            mass = _read_number(contents, MASS_UNITS, "LBS")
            grain = element.first("grain_config")
            if grain is not None:
                inertia = _grain_inertia(grain, element, mass)
            else:
                # JSBSim takes the fuel of a tank as a sphere.
                inertia = (_SPHERE * mass * _tank_radius(element) ** 2,) * 3
            yield _PointMass(mass, _read_position(location), inertia)


def _grain_inertia(grain: Element, tank: Element, mass: float) -> tuple[float, float, float]:
    """Return the inertia of a solid propellant about its centre and the body axes. [kg m2]"""
    if grain.attributes.get("type", "") != "CYLINDRICAL":
        raise grain.error(
            f"<grain_config> of the type {grain.attributes.get('type', '')!r}",
            "the type CYLINDRICAL; the inertia of others is not read",
        )
    capacity = _read_number(tank.need("capacity"), MASS_UNITS, "LBS")
    radius = _read_number(tank.need("radius"), LENGTH_UNITS, "IN")
    length = _read_number(grain.need("length"), LENGTH_UNITS, "IN")
    bore = 0.5 * _read_number(grain.need("bore_diameter"), LENGTH_UNITS, "IN")
    # The bore grows as the propellant burns: r^2 = R^2 - (R^2 - r0^2) contents / capacity.
    inner_squared = radius**2 - (radius**2 - bore**2) * mass / capacity
    along = 0.5 * mass * (radius**2 + inner_squared)
    across = 0.5 * along + mass * length**2 / 12.0
    return along, across, across


def _tank_radius(tank: Element) -> float:
    """Return the radius of a sphere with the inertia of a tank. [m]"""
    radius, factor = tank.first("radius"), tank.first("inertia_factor")
    if radius is None:
        return 0.0
    # The inertia is proportional to the square of the radius.
    inertia_factor = 1.0 if factor is None else factor.number
    return _read_number(radius, LENGTH_UNITS, "IN") * inertia_factor**0.5


def _read_position(location: Element) -> np.ndarray:
    """Return a point in structural axes, x aft and z up, along body axes. [m]"""
    scale = unit_of_element(location, "IN", LENGTH_UNITS)
    coordinates = []
    for axis, sign in zip("xyz", (-1.0, 1.0, -1.0), strict=True):
        coordinates.append(sign * location.need(axis).number * scale)
    return np.array(coordinates)


def _read_number(element: Element, units: dict[str, float], default: str) -> float:
    return element.number * unit_of_element(element, default, units)


def _inertia_about(point: _PointMass, cg: np.ndarray) -> np.ndarray:
    """Return the inertia tensor (3, 3) of a mass about the c.g. [kg m2]"""
    return point_inertia(point.mass, point.position - cg) + np.diag(point.inertia)
