"""Export of a database and its aircraft as a flight model of JSBSim in one XML file.

Every term is a function ``aero/coefficient/CL/gear`` below its axis: dynamic pressure times area
(times chord or span) times regressors times tables.  Force axes:

==========  ====================================================================================
stability   ``X``, ``Y``, ``Z`` with ``frame="STABILITY"``; JSBSim takes +CD as X and +CL as Z
wind        ``DRAG``, ``SIDE``, ``LIFT``
body        ``X``, ``Y``, ``Z`` with ``frame="BODY"``, unchanged
==========  ====================================================================================

Moments are in body axes about ``AERORP``, the moment reference point.  JSBSim holds tables beyond
their ends, like terms with ``outside`` = ``hold``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
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
)
from aerodb.exchange.jsbsim.propulsion.transfers import crossfeed_problems, warn_of_lost_tanks
from aerodb.exchange.jsbsim.propulsion.writing import export_jsbsim_engine, list_obstacles
from aerodb.exchange.jsbsim.vehicle_elements import (
    Propulsion,
    add_text_child,
    engine_terms,
    function_fields,
    has_propellers,
    missing_limits,
    write_engines,
    write_flight_control,
    write_geometry_and_mass,
    write_header,
    write_propulsion,
)
from aerodb.store.schema import HINGE, require_valid, terms
from flightmech.aircraft.aircraft import Aircraft, reference_in
from flightmech.errors import SchemaError
from flightmech.names import SEPARATION
from flightmech.support.atomic_write import written_atomically
from flightmech.terms import SOURCES, list_model_variables, list_regressors, power_factor

# Axis of JSBSim and its frame, by force axes and coefficient.
AXES = {
    "stability": {"CD": ("X", "STABILITY"), "CY": ("Y", "STABILITY"), "CL": ("Z", "STABILITY")},
    "wind": {"CD": ("DRAG", ""), "CY": ("SIDE", ""), "CL": ("LIFT", "")},
    "body": {"CX": ("X", "BODY"), "CY": ("Y", "BODY"), "CZ": ("Z", "BODY")},
}
# Axis of JSBSim and the length that multiplies the coefficient.
MOMENTS = {
    "Cl": ("ROLL", "metrics/bw-ft"),
    "Cm": ("PITCH", "metrics/cbarw-ft"),
    "Cn": ("YAW", "metrics/bw-ft"),
}
_AGREE = 1e-6  # relative change by a conversion of units and a netCDF round trip
_NEAR = 1e-4  # distance of equal moment reference points, in chords
_NATIVE_FOUR_AXES = (1, 3, 1)  # first JSBSim with tables of four axes


def export_jsbsim(
    db: xr.DataTree,
    path: str | os.PathLike[str],
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
        Geometry, mass and engines.  The ``limits`` scale the commands of -1 ... 1 (flaps 0 ... 1)
        to deflections.  A tab without limits has no command: its position,
        ``fcs/elevator-tab-pos-rad`` and the like, is set directly.
    jsbsim_min : str
        Oldest JSBSim that can load the file.  Below 1.3.1 a table of four axes is written as
        interpolated tables of three.
    reach : mapping of str to (low, high), optional
        Range per axis to which terms with ``outside`` = ``linear`` are continued by added
        breakpoints.  Without it they are refused, because JSBSim holds tables beyond their ends.
        [SI]

    Raises
    ------
    SchemaError
        With all problems: faults of the database, a geometry that differs from the aircraft's,
        terms that JSBSim cannot compute, a control without limits.

    Notes
    -----
    Engines with propellers become ``<propulsion>``, with files in the folder ``Engines`` next to
    the file.  Tanks that feed them are written with their priorities; JSBSim draws equal shares of
    tanks of one priority.  It has no cross-feed valve, and an engine with one is refused.  Transfer
    pumps become functions with a switch ``fcs/transfer-SOURCE-TARGET-on`` each, which
    `import_jsbsim_aircraft` reads.  Other engines become external forces ``engine1`` ..., with
    first-order lag.  The angular momentum of their rotors is lost.  They burn no fuel: an aircraft
    with tanks keeps their contents in its mass, and a warning states it.  The file
    has no landing gear, since an aircraft file has none.  JSBSim takes the load factor of its last
    step, and so do terms with ``dnz``.  Our simulation solves for the load factor of the same
    instant.  A drag polar ``CL CL`` becomes ``aero/cl-squared``, the lift of the last step of
    JSBSim.  Comments summarise standard errors
    and sources of the nodes, which the database file has in full.  `import_jsbsim` reads the file,
    term by term.
    """
    require_valid(db)
    reach = reach or {}
    aircraft = replace(aircraft, reference=reference_in(aircraft, db.attrs))
    version = tuple(int(part) for part in jsbsim_min.split("."))
    native = version >= _NATIVE_FOUR_AXES
    leaves = {name: leaf.squeeze(drop=True) for name, leaf in terms(db).items()}
    thrusts = engine_terms(aircraft)

    # All problems are listed in one error.
    problems = _geometry_problems(db, aircraft)
    for name, leaf in (*leaves.items(), *thrusts.items()):
        problems += [f"{name}: {text}" for text in _leaf_problems(leaf, aircraft, reach)]
    used = set().union(*(list_model_variables(leaf) for leaf in leaves.values()))
    problems += missing_limits(aircraft, used)
    for number, engine in enumerate(aircraft.engines, 1):
        if engine.propeller is not None:
            problems += [f"engine {number}: {text}" for text in list_obstacles(engine)]
            problems += crossfeed_problems(number, engine)
    if problems:
        raise SchemaError(f"JSBSim model of {aircraft.name}", problems)
    if not has_propellers(aircraft):
        warn_of_lost_tanks(aircraft)
    leaves = {name: extend_linearly(leaf, reach) for name, leaf in leaves.items()}
    thrusts = {name: extend_linearly(leaf, reach) for name, leaf in thrusts.items()}

    root = ET.Element("fdm_config", name=aircraft.name, version="2.0", release="BETA")
    write_header(root, db.attrs)
    write_geometry_and_mass(root, aircraft)
    write_engines(root, aircraft)
    write_propulsion(root, aircraft, _write_engine_files(aircraft, Path(path)))
    write_flight_control(root, aircraft, used, propulsion=Propulsion(thrusts, native))
    aerodynamics = ET.SubElement(root, "aerodynamics")
    for variable in FUNCTION:
        if any(_needs_function(variable, leaf) for leaf in leaves.values()):
            aerodynamics.append(_variable_function(variable, aircraft))
    _write_axes(aerodynamics, leaves, str(db.attrs["force_axes"]), native=native)
    _write_hinge_moments(aerodynamics, leaves, native)
    _replace_unprintable_characters(root)
    ET.indent(root, "  ")
    with written_atomically(path) as part:
        ET.ElementTree(root).write(part, encoding="utf-8", xml_declaration=True)


def _leaf_problems(
    leaf: xr.Dataset, aircraft: Aircraft, reach: Mapping[str, tuple[float, float]]
) -> list[str]:
    """Return the reasons for which JSBSim cannot compute a term."""
    problems = []
    for variable in sorted(list_model_variables(leaf) - _available_variables(leaf, aircraft)):
        if variable in SEPARATION:
            problems.append(
                f"{variable} is a state of the flow, which the export does not write; leave the "
                f"term out (aerodb.delete_terms), or write an FMU, which has it"
            )
            continue
        problems.append(
            f"{variable} is nothing that JSBSim knows or that can be computed from what it "
            f"knows; leave the term out (aerodb.delete_terms)"
        )
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


def _available_variables(leaf: xr.Dataset, aircraft: Aircraft) -> set[str]:
    """Return the variables that a term may have in JSBSim."""
    variables = {*AXIS, *REGRESSOR, *FUNCTION}
    # The thrust coefficient is the sum of the thrusts of the engines.
    if not aircraft.engines:
        variables.remove("CT")
    for number in range(1, len(aircraft.engines) + 1):
        variables |= {f"engine{number}.throttle", f"engine{number}.thrust"}
    # JSBSim has the lift coefficient as aero/cl-squared only.
    if list_regressors(leaf) == ("CL", "CL") and "CL" not in leaf.dims:
        variables.add("CL")
    return variables


def _geometry_problems(db: xr.DataTree, aircraft: Aircraft) -> list[str]:
    """Return the differences of reference quantities between database and aircraft."""
    problems = []
    for name in ("S", "cbar", "b"):
        database_value, aircraft_value = db.attrs[name], getattr(aircraft, name)
        if not np.isclose(database_value, aircraft_value, rtol=_AGREE, atol=0.0):
            problems.append(
                f"{name} is {database_value:.8g} in the database and {aircraft_value:.8g} "
                f"in the aircraft; they must agree"
            )
    tolerance = _NEAR * aircraft.cbar
    reference = reference_in(aircraft, db.attrs)
    for name, value in zip(("x_ref", "y_ref", "z_ref"), reference, strict=True):
        if not np.isclose(db.attrs[name], value, rtol=_AGREE, atol=tolerance):
            problems.append(
                f"{name} is {db.attrs[name]:.6g} m in the database and {value:.6g} m in the "
                f"aircraft; move the moment reference"
            )
    return problems


def _needs_function(variable: str, leaf: xr.Dataset) -> bool:
    """Return whether a term has an axis or a regressor that is not a property of JSBSim."""
    is_regressor = variable in list_regressors(leaf) and variable not in REGRESSOR
    return variable in leaf.dims or is_regressor


def _variable_function(variable: str, aircraft: Aircraft) -> ET.Element:
    """Return the function of a variable that JSBSim does not have."""
    fields = function_fields(aircraft)
    function = ET.Element("function", name=OWN + variable)
    function.append(ET.fromstring(FUNCTION[variable].format(**fields)))
    return function


def _write_axes(
    aerodynamics: ET.Element, leaves: Mapping[str, xr.Dataset], force_axes: str, native: bool
) -> None:
    """Write the terms of forces and moments below their axes."""
    # force = qbar S C, moment = qbar S length C
    scale = ["aero/qbar-psf", "metrics/Sw-sqft"]
    for coefficient, (name, frame) in AXES[force_axes].items():
        attributes = {"name": name, "frame": frame} if frame else {"name": name}
        axis = ET.SubElement(aerodynamics, "axis", attributes)
        _write_terms(axis, coefficient, leaves, scale=scale, native=native)
    for coefficient, (name, length) in MOMENTS.items():
        axis = ET.SubElement(aerodynamics, "axis", name=name)
        _write_terms(axis, coefficient, leaves, scale=[*scale, length], native=native)


def _write_terms(
    axis: ET.Element,
    coefficient: str,
    leaves: Mapping[str, xr.Dataset],
    scale: list[str],
    native: bool,
) -> None:
    """Write the terms of a coefficient; `scale` are the properties that multiply it."""
    for name, leaf in leaves.items():
        if name.split("/")[0] == coefficient:
            factors = [_property_element(property_name) for property_name in scale]
            _write_function(axis, name, leaf, factors=[*factors, *factor_elements(leaf, native)])


def _write_hinge_moments(
    aerodynamics: ET.Element, leaves: Mapping[str, xr.Dataset], native: bool
) -> None:
    """Write hinge-moment coefficients as functions that do not act on the aircraft."""
    # With type="post" JSBSim evaluates a function after the forces.
    for name, leaf in leaves.items():
        if name.split("/")[0] in HINGE:
            factors = factor_elements(leaf, native)
            _write_function(aerodynamics, name, leaf, factors=factors, type="post")


def _write_function(
    parent: ET.Element, name: str, leaf: xr.Dataset, factors: list[ET.Element], **attributes: str
) -> None:
    """Write a term as a function with a remark."""
    # XML does not allow two hyphens in a comment.
    parent.append(ET.Comment(f" {_summarise_term(leaf).replace('--', '- -')} "))
    function = ET.SubElement(parent, "function", {"name": COEFFICIENT + name, **attributes})
    if leaf.attrs.get("comment"):
        add_text_child(function, "description", _join_lines(leaf.attrs["comment"]))
    if len(factors) > 1:
        ET.SubElement(function, "product").extend(factors)
    else:
        function.extend(factors)


def _summarise_term(leaf: xr.Dataset) -> str:
    """Return form, sources and standard errors of a term in one line."""
    axes = ", ".join(map(str, leaf["value"].dims))
    parts = [" x ".join((*list_regressors(leaf), f"table({axes})"))]
    if "source" in leaf:
        flags, counts = np.unique(leaf["source"].values, return_counts=True)
        sources = [f"{SOURCES[flag]} {count}" for flag, count in zip(flags, counts, strict=True)]
        parts.append(f"nodes: {', '.join(sources)}")
    if "stderr" in leaf:
        stderr = leaf["stderr"].values
        parts.append(f"standard error {stderr.min():.3g} ... {stderr.max():.3g}")
    for key in ("references", "history"):
        if leaf.attrs.get(key):
            parts.append(str(leaf.attrs[key]))
    return _join_lines("; ".join(parts))


def _join_lines(text: object) -> str:
    return " ".join(str(text).split())


def _replace_unprintable_characters(root: ET.Element) -> None:
    """Replace the characters that XML does not allow by blanks, in all texts and attributes."""
    for element in root.iter():
        for key, text in element.attrib.items():
            element.attrib[key] = _to_printable(text)
        element.text = _to_printable(element.text) if element.text else None


def _to_printable(text: str) -> str:
    characters = []
    for character in text:
        is_allowed = character.isprintable() or character in "\n\t"
        characters.append(character if is_allowed else " ")
    return "".join(characters)


def _property_element(name: str) -> ET.Element:
    element = ET.Element("property")
    element.text = name
    return element


def _write_engine_files(aircraft: Aircraft, path: Path) -> list[tuple[str, str]]:
    """Write the files of engines with propellers, and return their names."""
    files = []
    for number, engine in enumerate(aircraft.engines, 1):
        if engine.propeller is not None:
            name = f"{path.stem}_{number}"
            files.append(export_jsbsim_engine(engine, path.parent / "Engines", name))
    return files
