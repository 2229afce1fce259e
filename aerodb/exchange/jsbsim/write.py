"""A database and its aircraft as a flight model of JSBSim: one XML file that it loads and flies.

Every term is a function ``aero/coefficient/CL/gear`` below its axis: dynamic pressure times area
(times chord or span) times regressors times tables.  Force axes:

==========  ==================================================================================================
stability   ``X``, ``Y``, ``Z`` with ``frame="STABILITY"``, in which JSBSim takes +CD as X and +CL as Z
wind        ``DRAG``, ``SIDE``, ``LIFT``
body        ``X``, ``Y``, ``Z`` with ``frame="BODY"``, as they are
==========  ==================================================================================================

Moments are body axes about ``AERORP``, the moment reference point.  JSBSim holds tables beyond
their ends, as terms with ``outside`` = ``hold`` do.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import xarray as xr

from aerodb.exchange.jsbsim.properties import (
    AXIS,
    COEFFICIENT,
    FUNCTION,
    OWN,
    REGRESSOR,
    extend_linearly,
    factor_elements,
    throttle_property,
    thrust_property,
)
from aerodb.store.schema import HINGE, require_valid, terms
from flightmech.aircraft.aircraft import Aircraft, reference_in
from flightmech.aircraft.engine import Engine
from flightmech.errors import SchemaError
from flightmech.support.atomic_write import written_atomically
from flightmech.terms import SOURCES, list_model_variables, list_regressors, power_factor
from flightmech.units import FOOT, INCH, POUND, POUND_FORCE, SLUG

_SLUGFT2 = SLUG * FOOT**2

# control: command and position; a positive aileron command rolls right, delta_a, delta_d and
# delta_s roll left
_SURFACES = {
    "delta_e": ("fcs/elevator-cmd-norm", AXIS["delta_e"]),
    "delta_r": ("fcs/rudder-cmd-norm", AXIS["delta_r"]),
    "delta_t": ("fcs/pitch-trim-cmd-norm", AXIS["delta_t"]),
    "delta_ta": ("fcs/roll-trim-cmd-norm", AXIS["delta_ta"]),
    "delta_tr": ("fcs/yaw-trim-cmd-norm", AXIS["delta_tr"]),
    "delta_d": ("-fcs/aileron-cmd-norm", AXIS["delta_d"]),
    "delta_s": ("-fcs/aileron-cmd-norm", AXIS["delta_s"]),
    "delta_f": ("fcs/flap-cmd-norm", AXIS["delta_f"]),
    "gear": ("gear/gear-cmd-norm", AXIS["gear"]),
    "speedbrake": ("fcs/speedbrake-cmd-norm", AXIS["speedbrake"]),
}
_TABS = ("delta_t", "delta_ta", "delta_tr")
_ONE_SIDED = ("delta_f", "gear", "speedbrake")
_DEFAULT = {"gear": (0.0, 1.0), "speedbrake": (0.0, 1.0)}


def write_header(root: ET.Element, attributes: Mapping) -> None:
    """Write title, source and history of the database."""
    head = ET.SubElement(root, "fileheader")
    for tag, key in (
        ("author", "source"),
        ("description", "title"),
        ("note", "comment"),
        ("note", "history"),
    ):
        if attributes.get(key):
            ET.SubElement(head, tag).text = str(attributes[key])
    if attributes.get("references"):
        ET.SubElement(
            head, "reference", author="", date="", title=str(attributes["references"]), refID="1"
        )


def write_geometry_and_mass(root: ET.Element, aircraft: Aircraft) -> None:
    """Write geometry and mass; products of inertia change sign with x and z, which point the other
    way in structural axes.
    """
    metrics = ET.SubElement(root, "metrics")
    _number(metrics, "wingarea", aircraft.S / FOOT**2, "FT2")
    _number(metrics, "wingspan", aircraft.b / FOOT, "FT")
    _number(metrics, "chord", aircraft.cbar / FOOT, "FT")
    for name in ("AERORP", "EYEPOINT", "VRP"):
        _location(metrics, aircraft, (0.0, 0.0, 0.0), name)
    mass = ET.SubElement(root, "mass_balance", negated_crossproduct_inertia="true")
    for name in ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"):
        sign = -1.0 if name == "Ixz" else 1.0
        _number(mass, name.lower(), sign * getattr(aircraft, name) / _SLUGFT2, "SLUG*FT2")
    _number(mass, "emptywt", aircraft.mass / POUND, "LBS")
    _location(mass, aircraft, aircraft.cg, "CG")
    ET.SubElement(root, "ground_reactions")


def write_engines(root: ET.Element, aircraft: Aircraft) -> None:
    """Write the engines as external forces that follow ``fcs/engine1-thrust-lbs``."""
    if not aircraft.engines:
        return
    reactions = ET.SubElement(root, "external_reactions")
    for number, engine in enumerate(aircraft.engines, 1):
        force = ET.SubElement(reactions, "force", name=f"engine{number}", frame="BODY")
        ET.SubElement(ET.SubElement(force, "function"), "property").text = thrust_property(number)
        _location(force, aircraft, engine.position)
        direction = ET.SubElement(force, "direction")
        for name, component in zip("xyz", engine.direction):
            ET.SubElement(direction, name).text = repr(float(component))


def flight_control(
    root: ET.Element,
    aircraft: Aircraft,
    used: Collection[str],
    thrusts: Mapping[str, xr.Dataset],
    native: bool,
) -> None:
    """Write how commands move the surfaces that the model uses, and the `thrusts` of the engines."""
    control = ET.SubElement(root, "flight_control", name=aircraft.name)
    for number, engine in enumerate(aircraft.engines, 1):
        ET.SubElement(control, "property", value="0").text = throttle_property(number)
        if engine.thrust is None:
            ET.SubElement(control, "property", value="0").text = thrust_property(number)
    free = [name for name in _TABS if name in used and name not in aircraft.limits]
    for name in free:  # without limits a tab has no command: whoever flies sets its position
        ET.SubElement(control, "property", value="0").text = AXIS[name]
    channel = ET.SubElement(control, "channel", name="Surfaces")
    for name, (command, position) in _SURFACES.items():
        if name in used and name not in free:
            _surface(channel, command, position, _limits(aircraft, name), name in _ONE_SIDED)
    if "delta_a" in used:
        low, high = _limits(aircraft, "delta_a")
        _surface(channel, "fcs/aileron-cmd-norm", "fcs/left-aileron-pos-rad", (-high, -low))
        _surface(channel, "-fcs/aileron-cmd-norm", "fcs/right-aileron-pos-rad", (low, high))
    for number, engine in enumerate(aircraft.engines, 1):
        name = f"engine{number}"
        if engine.thrust is not None:
            _engine(
                ET.SubElement(control, "channel", name=name),
                name,
                thrusts[f"{name}/thrust"],
                engine,
                native,
            )


def missing_limits(aircraft: Aircraft, used: Collection[str]) -> list[str]:
    """Return a problem for every control that the model uses and whose travel is not known; a tab
    needs none.
    """
    controls = [name for name in (*_SURFACES, "delta_a") if name in used]
    return [
        f"{name} has no limits in the aircraft file, which scale its command; add [limits] "
        f"{name} = [low, high]"
        for name in controls
        if name not in aircraft.limits and name not in _DEFAULT and name not in _TABS
    ]


def engine_terms(aircraft: Aircraft) -> dict[str, xr.Dataset]:
    """Return the static thrust of the engines as terms, ``engine1/thrust``, their lever called
    ``engine1.throttle``.
    """
    found = {}
    for number, engine in enumerate(aircraft.engines, 1):
        if engine.thrust is not None:
            leaf, own = engine.thrust.squeeze(drop=True), f"engine{number}.throttle"
            words = [own if word == "throttle" else word for word in list_regressors(leaf)]
            named = leaf.rename({"throttle": own}) if "throttle" in leaf.dims else leaf
            found[f"engine{number}/thrust"] = named.assign_attrs(regressors=" ".join(words))
    return found


def function_fields(aircraft: Aircraft) -> dict[str, object]:
    """Return what the functions for variables that JSBSim has not take from the aircraft."""
    thrusts = "".join(
        f"<property>{thrust_property(number)}</property>"
        for number in range(1, len(aircraft.engines) + 1)
    )
    return {
        "x_ref_mac": aircraft.x_ref_mac,
        "chords_per_inch": INCH / aircraft.cbar,
        "thrusts": thrusts,
    }


def _limits(aircraft: Aircraft, name: str) -> tuple[float, float]:
    return aircraft.limits.get(name) or _DEFAULT[name]


def _surface(
    channel: ET.Element,
    command: str,
    position: str,
    limits: tuple[float, float],
    one_sided: bool = False,
) -> None:
    """Write the scaling of a command: 0 ... 1 from the low to the high limit, or -1 ... 1 with zero
    at zero.
    """
    scale = ET.SubElement(
        channel, "aerosurface_scale", name=f"{position.split('/')[1].split('-pos')[0]}-travel"
    )
    ET.SubElement(scale, "input").text = command
    if one_sided:
        _pair(scale, "domain", (0.0, 1.0))
        ET.SubElement(scale, "zero_centered").text = "false"
    _pair(scale, "range", limits)
    ET.SubElement(scale, "output").text = position


def _pair(parent: ET.Element, tag: str, pair: tuple[float, float]) -> None:
    element = ET.SubElement(parent, tag)
    for name, value in zip(("min", "max"), pair):
        ET.SubElement(element, name).text = repr(float(value))


def _engine(channel: ET.Element, name: str, leaf: xr.Dataset, engine: Engine, native: bool) -> None:
    """Write the static thrust of an engine and its lag."""
    function = ET.SubElement(
        ET.SubElement(channel, "fcs_function", name=f"fcs/{name}-static-thrust-lbs"), "function"
    )
    product = ET.SubElement(function, "product")
    _child(product, "value", repr(1.0 / POUND_FORCE))
    product.extend(factor_elements(leaf, native))
    lags = engine.time_constant > 0.0
    follower = ET.SubElement(channel, "lag_filter" if lags else "pure_gain", name=f"{name}-spool")
    _child(follower, "input", f"fcs/{name}-static-thrust-lbs")
    _child(follower, "c1" if lags else "gain", repr(1.0 / engine.time_constant) if lags else "1")
    _child(follower, "output", f"fcs/{name}-thrust-lbs")


def _location(
    parent: ET.Element, aircraft: Aircraft, position: tuple[float, float, float], name: str = ""
) -> None:
    """Write a point that is `position` from the moment reference point, body axes, in structural
    axes.
    """
    location = ET.SubElement(parent, "location", {**({"name": name} if name else {}), "unit": "IN"})
    for axis, sign, origin, offset in zip(
        "xyz", (-1.0, 1.0, -1.0), reference_in(aircraft, {}), position
    ):
        _child(location, axis, repr(sign * (origin + offset) / INCH))


def _number(parent: ET.Element, tag: str, value: float, unit: str) -> None:
    element = ET.SubElement(parent, tag, unit=unit)
    element.text = repr(value)


def _child(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = text


AXES = {
    "stability": {"CD": ("X", "STABILITY"), "CY": ("Y", "STABILITY"), "CL": ("Z", "STABILITY")},
    "wind": {"CD": ("DRAG", ""), "CY": ("SIDE", ""), "CL": ("LIFT", "")},
    "body": {"CX": ("X", "BODY"), "CY": ("Y", "BODY"), "CZ": ("Z", "BODY")},
}
MOMENTS = {
    "Cl": ("ROLL", "metrics/bw-ft"),
    "Cm": ("PITCH", "metrics/cbarw-ft"),
    "Cn": ("YAW", "metrics/bw-ft"),
}
_AGREE = 1e-6  # relative: what a unit conversion and a netCDF round trip may change
_NEAR = 1e-4  # of the chord: two places of the moment reference that count as one


def export_jsbsim(
    db: xr.DataTree,
    path: str | os.PathLike,
    aircraft: Aircraft,
    *,
    jsbsim_min: str = "1.3.1",
    reach: Mapping[str, tuple[float, float]] | None = None,
) -> None:
    """Write a database and its aircraft as a JSBSim flight model.

    Parameters
    ----------
    db : DataTree
        The database.
    path : path
        The XML file, such as ``aircraft/t37/t37.xml``.
    aircraft : Aircraft
        Geometry, mass and engines; the ``limits`` scale the commands of -1 ... 1 (flaps 0 ... 1) to
        deflections.  A tab without limits has no command: its position,
        ``fcs/elevator-tab-pos-rad`` and the like, is set directly.
    jsbsim_min : str
        Oldest JSBSim that shall load the file; below 1.3.1 a table of four axes is written as
        interpolated tables of three.
    reach : mapping of str to (low, high), optional
        Range per axis to which terms with ``outside`` = ``linear`` are continued by added
        breakpoints; without it they are refused, because JSBSim holds tables beyond their ends.
        [SI]

    Raises
    ------
    SchemaError
        With all problems: faults of the database, a geometry that is not the aircraft's, terms that
        JSBSim cannot compute, a control without limits.

    Notes
    -----
    Engines become external forces ``engine1`` ..., first-order lag included; the angular momentum of their rotors is lost.
    The file has no landing gear, since an aircraft file has none.  JSBSim takes the load factor of its last step, and so do
    terms with ``dnz``; they are solved for in our own simulation.  A drag polar ``CL CL`` becomes ``aero/cl-squared``, the lift of its
    last step.  Standard errors and sources of the nodes are summed up in
    comments; the database file stays the master.  `import_jsbsim` reads the file back, term by term.
    """
    require_valid(db)
    aircraft = replace(aircraft, reference=reference_in(aircraft, db.attrs))
    native = tuple(int(part) for part in jsbsim_min.split(".")) >= (1, 3, 1)
    leaves = {name: leaf.squeeze(drop=True) for name, leaf in terms(db).items()}
    thrusts = engine_terms(aircraft)
    problems = _disagreements(db, aircraft)
    for name, leaf in (*leaves.items(), *thrusts.items()):
        problems += [f"{name}: {text}" for text in _leaf_problems(leaf, aircraft, reach or {})]
    used = set().union(*(list_model_variables(leaf) for leaf in leaves.values()))
    problems += missing_limits(aircraft, used)
    if problems:
        raise SchemaError(f"JSBSim model of {aircraft.name}", problems)
    leaves, thrusts = (
        {name: extend_linearly(leaf, reach or {}) for name, leaf in found.items()}
        for found in (leaves, thrusts)
    )

    root = ET.Element("fdm_config", name=aircraft.name, version="2.0", release="BETA")
    write_header(root, db.attrs)
    write_geometry_and_mass(root, aircraft)
    write_engines(root, aircraft)
    flight_control(root, aircraft, used, thrusts, native)
    aerodynamics = ET.SubElement(root, "aerodynamics")
    for variable in FUNCTION:
        if any(_needs_function(variable, leaf) for leaf in leaves.values()):
            aerodynamics.append(_own_function(variable, aircraft))
    _axes(aerodynamics, leaves, str(db.attrs["force_axes"]), native)
    _hinge_moments(aerodynamics, leaves, native)
    _make_printable(root)
    ET.indent(root, "  ")
    with written_atomically(path) as part:
        ET.ElementTree(root).write(part, encoding="utf-8", xml_declaration=True)


def _leaf_problems(
    leaf: xr.Dataset, aircraft: Aircraft, reach: Mapping[str, tuple[float, float]]
) -> list[str]:
    engines = [
        f"engine{number}.{kind}"
        for number in range(1, len(aircraft.engines) + 1)
        for kind in ("throttle", "thrust")
    ]
    known = {*AXIS, *REGRESSOR, *FUNCTION, *engines} - ({"CT"} if not engines else set())
    if (
        list_regressors(leaf) == ("CL", "CL") and "CL" not in leaf.dims
    ):  # the one way in which JSBSim knows the lift
        known.add("CL")
    problems = [
        f"{variable} is nothing that JSBSim knows or that can be computed from what it "
        f"knows; leave the term out (aerodb.delete_terms)"
        for variable in sorted(list_model_variables(leaf) - known)
    ]
    factor = power_factor(leaf)
    if factor is not None:
        problems.append(
            f"the factor {factor} is a formula, and the export writes tables; make it one "
            f"first (aerodb.transform.with_height_table)"
        )
    if leaf.attrs.get("outside", "hold") == "linear":
        axes = [str(axis) for axis in leaf.dims if axis not in reach]
        if axes:
            problems.append(
                f"goes on linearly beyond its table and JSBSim holds the last value; give "
                f"reach = {{{axes[0]!r}: (low, high)}} for "
                f"{', '.join(axes)} to have breakpoints added, or make the attribute outside 'hold'"
            )
    return problems


def _disagreements(db: xr.DataTree, aircraft: Aircraft) -> list[str]:
    problems = [
        f"{name} is {db.attrs[name]:.8g} in the database and {getattr(aircraft, name):.8g} "
        f"in the aircraft; they must agree"
        for name in ("S", "cbar", "b")
        if not np.isclose(db.attrs[name], getattr(aircraft, name), rtol=_AGREE, atol=0.0)
    ]
    for name, own in zip(("x_ref", "y_ref", "z_ref"), reference_in(aircraft, db.attrs)):
        if not np.isclose(db.attrs[name], own, rtol=_AGREE, atol=_NEAR * aircraft.cbar):
            problems.append(
                f"{name} is {db.attrs[name]:.6g} m in the database and {own:.6g} m in the "
                f"aircraft; move the moment reference"
            )
    return problems


def _needs_function(variable: str, leaf: xr.Dataset) -> bool:
    """Return whether a term looks up, or multiplies by, a variable that JSBSim has not as a
    property.
    """
    return variable in leaf.dims or (
        variable in list_regressors(leaf) and variable not in REGRESSOR
    )


def _own_function(variable: str, aircraft: Aircraft) -> ET.Element:
    fields = function_fields(aircraft)
    function = ET.Element("function", name=OWN + variable)
    function.append(ET.fromstring(FUNCTION[variable].format(**fields)))
    return function


def _axes(
    aerodynamics: ET.Element, leaves: Mapping[str, xr.Dataset], force_axes: str, native: bool
) -> None:
    for coefficient, (name, frame) in AXES[force_axes].items():
        axis = ET.SubElement(
            aerodynamics, "axis", {"name": name, **({"frame": frame} if frame else {})}
        )
        _functions(axis, coefficient, leaves, [], native)
    for coefficient, (name, length) in MOMENTS.items():
        _functions(
            ET.SubElement(aerodynamics, "axis", name=name), coefficient, leaves, [length], native
        )


def _functions(
    axis: ET.Element,
    coefficient: str,
    leaves: Mapping[str, xr.Dataset],
    lengths: list[str],
    native: bool,
) -> None:
    for name, leaf in leaves.items():
        if name.split("/")[0] == coefficient:
            scale = [
                _text("property", word) for word in ("aero/qbar-psf", "metrics/Sw-sqft", *lengths)
            ]
            _function(axis, name, leaf, [*scale, *factor_elements(leaf, native)])


def _hinge_moments(
    aerodynamics: ET.Element, leaves: Mapping[str, xr.Dataset], native: bool
) -> None:
    """Write hinge-moment coefficients: functions that JSBSim evaluates after the forces and that
    act on nothing.
    """
    for name, leaf in leaves.items():
        if name.split("/")[0] in HINGE:
            _function(aerodynamics, name, leaf, factor_elements(leaf, native), type="post")


def _function(
    parent: ET.Element, name: str, leaf: xr.Dataset, parts: list[ET.Element], **attributes: str
) -> None:
    parent.append(ET.Comment(f" {_remark(leaf).replace('--', '- -')} "))
    function = ET.SubElement(parent, "function", {"name": COEFFICIENT + name, **attributes})
    if leaf.attrs.get("comment"):
        function.append(_text("description", _line(leaf.attrs["comment"])))
    (ET.SubElement(function, "product") if len(parts) > 1 else function).extend(parts)


def _remark(leaf: xr.Dataset) -> str:
    """Return in one line what the term is, where its nodes come from and how far they can be
    trusted.
    """
    words = [
        " x ".join((*list_regressors(leaf), f"table({', '.join(map(str, leaf['value'].dims))})"))
    ]
    if "source" in leaf:
        flags, counts = np.unique(leaf["source"].values, return_counts=True)
        words.append(
            "nodes: " + ", ".join(f"{SOURCES[flag]} {count}" for flag, count in zip(flags, counts))
        )
    if "stderr" in leaf:
        words.append(
            f"standard error {leaf['stderr'].values.min():.3g} ... "
            f"{leaf['stderr'].values.max():.3g}"
        )
    words += [str(leaf.attrs[key]) for key in ("references", "history") if leaf.attrs.get(key)]
    return _line("; ".join(words))


def _line(text: object) -> str:
    return " ".join(str(text).split())


def _make_printable(root: ET.Element) -> None:
    """Take out of all texts what XML cannot hold, control characters among it."""
    for element in root.iter():
        element.attrib.update({key: _printable(text) for key, text in element.attrib.items()})
        element.text = _printable(element.text) if element.text else None


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() or c in "\n\t" else " " for c in text)


def _text(tag: str, text: str) -> ET.Element:
    element = ET.Element(tag)
    element.text = text
    return element
