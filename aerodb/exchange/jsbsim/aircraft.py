"""The aircraft of a JSBSim file: geometry, mass, centre of gravity and inertia with its point
masses and the fuel on board.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from aerodb.exchange.jsbsim.read import _LENGTH, _reference, _section, _sizes, _unit
from aerodb.exchange.xml_reader import Element, read_xml
from flightmech.aircraft.aircraft import Aircraft
from flightmech.units import FOOT, POUND, SLUG

_MASS = {"LBS": POUND, "KG": 1.0}
_INERTIA = {"SLUG*FT2": SLUG * FOOT**2, "KG*M2": 1.0}


class _PointMass(NamedTuple):
    """A mass [kg], its place from the drawing datum along body axes [m], and its inertia about
    itself, alike about all axes [kg m2].
    """

    mass: float
    place: np.ndarray
    own: float = 0.0


def import_jsbsim_aircraft(
    path: str | os.PathLike, *, name: str = "", x_ref_mac: float = 0.25
) -> Aircraft:
    """Read the aircraft that belongs to the aerodynamics of a JSBSim file.

    Parameters
    ----------
    path : path
        The aircraft file.
    name : str
        Of the aircraft; that in the file unless given.
    x_ref_mac : float
        ``AERORP`` behind the leading edge of the mean chord, which JSBSim does not state. [chords]

    Returns
    -------
    Aircraft
        Reference quantities, moment reference ``AERORP``, mass, c.g. and inertia of the empty
        aircraft with its point masses and the contents of its tanks, as JSBSim starts.  Engines,
        landing gear and travel of the controls are not read: they stand in other files and other
        forms there; the history states so.

    Raises
    ------
    ParseError
        Not an aircraft file, no mass or inertia, an unknown unit, point masses with an extent, gas
        cells; with the line.
    """
    root = read_xml(Path(path))
    if root.tag != "fdm_config":
        raise root.error(f"<{root.tag}>", "an aircraft file of JSBSim, <fdm_config>")
    gas = root.first("buoyant_forces")
    if gas is not None:
        raise gas.error(
            "<buoyant_forces>",
            "an aircraft without gas cells; the mass and inertia of the gas are not read",
        )
    metrics, balance = _section(root, "metrics"), _section(root, "mass_balance")
    sizes, reference = _sizes(metrics), _reference(metrics)
    datum = np.array([reference[f"{axis}_ref"] for axis in "xyz"])
    empty = _PointMass(_number(balance.need("emptywt"), _MASS, "LBS"), _place(_cg(balance)))
    points = [*_point_masses(balance), *_tanks(root)]
    mass = empty.mass + sum(point.mass for point in points)
    cg = (
        empty.mass * empty.place + sum((point.mass * point.place for point in points), np.zeros(3))
    ) / mass
    J = _inertia(balance) + sum((_about(point, cg) for point in (empty, *points)), np.zeros((3, 3)))
    left_out = "engines, landing gear and limits of the controls are not read"
    return Aircraft(
        name or root.attributes.get("name", "") or Path(path).stem,
        S=sizes["S"],
        cbar=sizes["cbar"],
        b=sizes["b"],
        mass=float(mass),
        Ixx=float(J[0, 0]),
        Iyy=float(J[1, 1]),
        Izz=float(J[2, 2]),
        Ixy=float(-J[0, 1]),
        Ixz=float(-J[0, 2]),
        Iyz=float(-J[1, 2]),
        reference=(float(datum[0]), float(datum[1]), float(datum[2])),
        x_ref_mac=x_ref_mac,
        cg=tuple(map(float, cg - datum)),  # type: ignore[arg-type]
        history=f"import_jsbsim_aircraft: {Path(path).name}, {len(points)} point masses and "
        f"tanks; {left_out}",
    )


def _inertia(balance: Element) -> np.ndarray:
    """Return the inertia tensor (3, 3) of the empty aircraft about its c.g., body axes. [kg m2]

    x and z of structural axes are turned round, which changes the sign of the products with one of
    them.
    """
    read = {
        key: 0.0 if (e := balance.first(key)) is None else _number(e, _INERTIA, "SLUG*FT2")
        for key in ("ixy", "ixz", "iyz")
    }
    xx, yy, zz = (_number(balance.need(key), _INERTIA, "SLUG*FT2") for key in ("ixx", "iyy", "izz"))
    sign = -1.0 if balance.attributes.get("negated_crossproduct_inertia", "true") == "true" else 1.0
    xy, xz, yz = sign * read["ixy"], -sign * read["ixz"], sign * read["iyz"]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _cg(balance: Element) -> Element:
    for location in balance.all("location"):
        if location.attributes.get("name") == "CG":
            return location
    raise balance.error(
        "no location CG", "the centre of gravity of the empty aircraft, <location name='CG'>"
    )


def _point_masses(balance: Element) -> Iterator[_PointMass]:
    for element in balance.all("pointmass"):
        form = element.first("form")
        if form is not None:
            raise form.error(
                "<form> of a point mass",
                "point masses without an extent of their own; its inertia is not read",
            )
        yield _PointMass(
            _number(element.need("weight"), _MASS, "LBS"), _place(element.need("location"))
        )


def _tanks(root: Element) -> Iterator[_PointMass]:
    """Yield the contents of the tanks."""
    if root.first("propulsion") is None:
        return
    for element in _section(root, "propulsion").all("tank"):
        contents, location = element.first("contents"), element.first("location")
        if contents is not None and location is not None:
            mass = _number(contents, _MASS, "LBS")
            yield _PointMass(
                mass, _place(location), 0.4 * mass * _radius(element) ** 2
            )  # JSBSim takes it for a sphere


def _radius(tank: Element) -> float:
    """Return the radius of a sphere with the inertia of a tank. [m]"""
    radius, factor = tank.first("radius"), tank.first("inertia_factor")
    return (
        0.0
        if radius is None
        else _number(radius, _LENGTH, "IN") * (1.0 if factor is None else factor.number) ** 0.5
    )


def _place(location: Element) -> np.ndarray:
    """Return a place of structural axes, x aft and z up, along body axes. [m]"""
    scale = _unit(location, "IN", _LENGTH)
    return np.array(
        [sign * location.need(axis).number * scale for axis, sign in zip("xyz", (-1.0, 1.0, -1.0))]
    )


def _number(element: Element, units: dict[str, float], default: str) -> float:
    return element.number * _unit(element, default, units)


def _about(point: _PointMass, cg: np.ndarray) -> np.ndarray:
    """Return the inertia tensor (3, 3) of a mass about the c.g. [kg m2]"""
    arm = point.place - cg
    return point.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm)) + point.own * np.eye(3)
