"""Import of the aerodynamics of a JSBSim aircraft file as a database.

The import accepts functions that are sums of products of numbers, properties and tables of one to
four axes.  The axes are ``DRAG SIDE LIFT`` (wind), ``AXIAL SIDE NORMAL`` (body), ``X Y Z`` with a
frame, and ``ROLL PITCH YAW`` (body).  Degrees become radians, feet metres, and a rate times
``bi2vel`` or ``ci2vel`` a reduced rate.
"""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import xarray as xr

from aerodb.exchange.jsbsim.functions import Functions
from aerodb.exchange.jsbsim.inputs import Inputs, declared_constants
from aerodb.exchange.jsbsim.metrics import (
    read_incidence,
    read_reference,
    read_section,
    read_sizes,
    read_tail_sizes,
)
from aerodb.exchange.jsbsim.products import NotAProduct, OpaqueFactor, scale_products
from aerodb.exchange.jsbsim.properties import COEFFICIENT, stated_travel
from aerodb.exchange.jsbsim.remarks import (
    describe_devices,
    describe_repeated,
)
from aerodb.exchange.jsbsim.sampling import sample_product
from aerodb.exchange.jsbsim.terms import term_of_product
from aerodb.exchange.spelling import spell
from aerodb.exchange.xml_reader import Element, read_xml
from aerodb.store.schema import HINGE, make_database
from flightmech.errors import AeromatchWarning, SchemaError, UnknownName
from flightmech.units import DEGREE, FOOT

# Axis and frame of the file: force axes of the database, coefficient, sign of the coefficient.
# JSBSim reverses X and Z of the stability and wind frames: they are drag and lift.
_FRAMES = {
    ("LIFT", ""): ("wind", "CL", 1.0),
    ("DRAG", ""): ("wind", "CD", 1.0),
    ("AXIAL", ""): ("body", "CX", -1.0),
    ("NORMAL", ""): ("body", "CZ", -1.0),
    ("X", ""): ("body", "CX", 1.0),
    ("Y", ""): ("body", "CY", 1.0),
    ("Z", ""): ("body", "CZ", 1.0),
    ("X", "BODY"): ("body", "CX", 1.0),
    ("Y", "BODY"): ("body", "CY", 1.0),
    ("Z", "BODY"): ("body", "CZ", 1.0),
    ("X", "STABILITY"): ("stability", "CD", 1.0),
    ("Y", "STABILITY"): ("stability", "CY", 1.0),
    ("Z", "STABILITY"): ("stability", "CL", 1.0),
    ("X", "WIND"): ("wind", "CD", 1.0),
    ("Y", "WIND"): ("wind", "CY", 1.0),
    ("Z", "WIND"): ("wind", "CL", 1.0),
}
# Axis of the file: coefficient and the length that multiplies it.
_MOMENTS = {"ROLL": ("Cl", "b"), "PITCH": ("Cm", "cbar"), "YAW": ("Cn", "b")}
_AILERONS = "both ailerons are taken to move by the same angle, left = -delta_a and right = delta_a"
_SEPARATOR = re.compile(r"[^A-Za-z0-9_]+")


@dataclass(frozen=True)
class _JsbsimAxis:
    """An axis of the file.

    Parameters
    ----------
    coefficient : str
        Its coefficient.
    sign : float
        Sign of the coefficient in the functions.
    per : mapping of str to int
        Powers of dynamic pressure, area and length that multiply the coefficient.
    functions : list of Element
        Its functions.
    """

    coefficient: str
    sign: float
    per: Mapping[str, int]
    functions: list[Element]


@dataclass(frozen=True)
class _Options:
    """Options of `import_jsbsim` for the conversion of functions."""

    leave_out: Collection[str] = ()
    sample: float | None = None
    box: Mapping[str, tuple[float, float]] = field(default_factory=dict)


def import_jsbsim(
    path: str | os.PathLike[str],
    *,
    travel: Mapping[str, float] | None = None,
    names: Mapping[str, str] | None = None,
    leave_out: Collection[str] = (),
    sample: float | None = None,
    box: Mapping[str, tuple[float, float]] | None = None,
) -> xr.DataTree:
    """Read the aerodynamics of a JSBSim aircraft file.

    Parameters
    ----------
    path : path
        The aircraft file.
    travel : mapping of str to float, optional
        Deflection at which a normalised position is 1, ``{"delta_f": 0.698}`` for
        ``fcs/flap-pos-norm``.  A position that the control system of the file scales to its
        fraction needs no entry. [rad]
    names : mapping of str to str, optional
        Variable of the vocabulary by property, with its sign and unit in the file:
        ``{"fcs/posElev_rad": "delta_e [rad]", "fcs/posAilR_rad": "-delta_a [rad]"}``.  Without a
        unit it is that at the end of the property, or else that of JSBSim.  A property of controls
        or systems without a name is an input, ``device.fcs_spoiler_pos_norm.setting``.
    leave_out : collection of str, optional
        Names of functions to leave out.  They are listed in ``absent``.
    sample : float, optional
        Largest difference if a function that is not a product of tables is sampled on one table.
        Without it such functions are refused.  [1, or per unit of the regressors]
    box : mapping of str to (low, high), optional
        Range of variables for `sample`.  The default is the range of the tables over it. [SI]

    Returns
    -------
    DataTree
        A database in the force axes of the file.  Terms have the names of the functions,
        ``CL/CLalpha``.  Terms of `export_jsbsim` have their original names.  The moment reference
        is ``AERORP``.

    Raises
    ------
    ParseError
        The file is not an aircraft file, or it has a faulty table or an unknown unit; with the
        line.
    SchemaError
        Functions that are not terms; with the reason of each.
    UnknownName
        A name in `leave_out` or `names` that the file does not have, or a variable of `names` that
        the vocabulary does not have.

    Warns
    -----
    AeromatchWarning
        Properties are not in the vocabulary and became inputs of the model, or a function is
        defined twice.

    Notes
    -----
    ``aero/cl-squared`` is ``CL CL``, the lift coefficient of the same instant.  JSBSim takes the
    lift of the step before over the present dynamic pressure.  Both ailerons move by the same
    angle: ``left-aileron-pos`` is -delta_a.  Magnitudes such as ``aero/mag-beta-rad``, and a third
    factor such as ``gear-pos-norm``, become tables over all values of the variable.
    """
    path = Path(path)
    root = read_xml(path)
    if root.tag != "fdm_config":
        raise root.error(f"<{root.tag}>", "an aircraft file of JSBSim, <fdm_config>")
    metrics, aerodynamics = read_section(root, "metrics"), read_section(root, "aerodynamics")
    sizes = read_sizes(metrics)
    force_axes, axes = _read_axes(aerodynamics)
    named = _named_functions(aerodynamics)
    for name in leave_out:
        if name not in named:
            raise UnknownName(name, named, "function")

    # Functions compute in feet, as JSBSim does.
    sizes_in_feet = {
        "S": sizes["S"] / FOOT**2,
        "cbar": sizes["cbar"] / FOOT,
        "b": sizes["b"] / FOOT,
    }
    incidence = read_incidence(metrics)
    constants = {
        **declared_constants([root, aerodynamics]),
        **read_tail_sizes(metrics),
        "metrics/iw-rad": incidence,
        "metrics/iw-deg": incidence / DEGREE,
    }
    all_travel = {**_stated_travel(root), **(travel or {})}
    inputs = Inputs(all_travel, _check_names(aerodynamics, names or {}), constants, incidence)
    functions = Functions(named, sizes_in_feet, inputs)
    options = _Options(leave_out, sample, box or {})
    leaves, problems = _convert_functions(axes, functions, options)
    if problems:
        raise SchemaError(
            f"{path}: functions that are not terms; "
            + spell(
                "leave_out = [names] does without them, sample = bound tabulates what can be",
                "--without NAME does without one, --sample BOUND tabulates what can be",
            ),
            problems,
        )
    remarks = [_AILERONS] if _uses_ailerons(axes) else []
    for remark in (describe_repeated(aerodynamics), describe_devices(inputs, leaves)):
        if remark:
            warnings.warn(f"{path.name}: {remark}", AeromatchWarning, stacklevel=2)
            remarks.append(remark)
    return make_database(
        leaves,
        title=_title(root),
        aircraft=root.attributes.get("name", "") or path.stem,
        **sizes,
        **read_reference(metrics),
        force_axes=force_axes,
        source=f"JSBSim aircraft file {path.name}",
        history=f"import_jsbsim: {path.name}",
        comment="\n".join(remarks),
        absent=" ".join(_absent_terms(axes, leave_out)),
    )


def _named_functions(aerodynamics: Element) -> dict[str, Element]:
    named = {}
    for element in aerodynamics.walk():
        name = element.attributes.get("name", "")
        if element.tag == "function" and name:
            named[name] = element
    return named


def _check_names(aerodynamics: Element, names: Mapping[str, str]) -> Mapping[str, str]:
    """Return the names of the caller; a property that the file does not use is an error."""
    if not names:
        return names
    properties = set()
    for element in aerodynamics.walk():
        if element.tag in ("property", "p", "independentVar"):
            properties.add(element.text.lstrip("-"))
    for name in names:
        if name.strip() not in properties:
            raise UnknownName(name, properties, "property")
    return names


def _uses_ailerons(axes: list[_JsbsimAxis]) -> bool:
    """Return whether a function contains the position of one aileron."""
    for axis in axes:
        for function in axis.functions:
            if any("aileron-pos" in element.text for element in function.walk()):
                return True
    return False


def _absent_terms(axes: list[_JsbsimAxis], leave_out: Collection[str]) -> list[str]:
    """Return the terms of the functions that are left out."""
    terms = []
    for axis in axes:
        for function in axis.functions:
            title = function.attributes.get("name", "")
            if title in leave_out:
                terms.append(f"{axis.coefficient}/{_to_word(title)}")
    return terms


def _convert_functions(
    axes: list[_JsbsimAxis], functions: Functions, options: _Options
) -> tuple[dict[str, xr.Dataset], list[str]]:
    """Return the terms by name, and a problem for each function that is not a sum of terms."""
    leaves: dict[str, xr.Dataset] = {}
    problems = []
    for axis in axes:
        for element in axis.functions:
            title = element.attributes.get("name", "")
            if title in options.leave_out:
                continue
            label = f"line {element.line}: {title or 'function'}"
            try:
                _convert_function(element, axis, functions, options=options, leaves=leaves)
            except NotAProduct as reason:
                problems.append(f"{label}: {reason}")
            except SchemaError as error:
                problems += [f"{label}: {reason}" for reason in error.problems]
    return leaves, problems


def _convert_function(
    element: Element,
    axis: _JsbsimAxis,
    functions: Functions,
    *,
    options: _Options,
    leaves: dict[str, xr.Dataset],
) -> None:
    """Add the terms of a function to `leaves`, one for each of its products."""
    title, file = element.attributes.get("name", ""), Path(element.file).name
    texts = {
        "comment": _description(element),
        "references": f"{file}, line {element.line}, {title}",
        "history": f"import_jsbsim: {file}",
    }

    def sample_factors(
        opaque: list[OpaqueFactor], tables: list[xr.DataArray]
    ) -> tuple[xr.DataArray, str]:
        return sample_product(opaque, tables, options.sample, options.box)

    for product in scale_products(axis.sign, functions.products(element)):
        leaf = term_of_product(product, axis.per, functions.sizes, sample_factors, **texts)
        name = f"{axis.coefficient}/{_contribution_name(title, axis.coefficient)}"
        leaves[_unused_name(name, leaves)] = leaf


def _read_axes(aerodynamics: Element) -> tuple[str, list[_JsbsimAxis]]:
    """Return the force axes of the file and its axes, followed by hinge moments."""
    frames: dict[str, Element] = {}
    axes: list[_JsbsimAxis] = []
    elements = aerodynamics.all("axis")
    names = {element.attributes.get("name", "") for element in elements}
    for element in elements:
        if element.attributes.get("unit", "LBS") not in ("LBS", "LBSFT", "LBS*FT"):
            raise element.error(
                f"unit {element.attributes['unit']!r}",
                "forces in LBS and moments in LBSFT, as JSBSim takes them",
            )
        frame, axis = _read_axis(element, names)
        if any(axis.coefficient == earlier.coefficient for earlier in axes):
            raise element.error(
                f"a second axis {element.attributes['name']}",
                "each axis once; JSBSim keeps the last one only, join them",
            )
        axes.append(axis)
        if frame:
            frames.setdefault(frame, element)
    if len(frames) > 1:
        raise list(frames.values())[1].error(
            f"force axes {' and '.join(frames)}",
            "one set: DRAG SIDE LIFT, AXIAL SIDE NORMAL or X Y Z in one frame",
        )
    for element in aerodynamics.children:
        if element.tag == "aero_ref_pt_shift_x":
            raise element.error(
                "<aero_ref_pt_shift_x>",
                "a fixed moment reference; the database has no term for one that moves",
            )
    # A file without forces has no frame.
    return next(iter(frames), "wind"), [*axes, *_hinge_axes(aerodynamics)]


def _read_axis(element: Element, names: set[str]) -> tuple[str, _JsbsimAxis]:
    """Return the frame of the forces ("" for moments) and the axis; `names` are all axes."""
    name, frame = element.attributes.get("name", ""), element.attributes.get("frame", "")
    functions = element.all("function")
    for function in functions:
        if function.attributes.get("apply_at_cg") == "true":
            raise function.error(
                'apply_at_cg="true"',
                "forces at the moment reference; all of them are moved to the c.g.",
            )
    if name in _MOMENTS:
        if frame not in ("", "BODY"):
            raise element.error(
                f"moments in the frame {frame}",
                "moments in body axes; turn them, which changes the tables with alpha",
            )
        coefficient, span = _MOMENTS[name]
        return "", _JsbsimAxis(coefficient, 1.0, {"qbar": 1, "S": 1, span: 1}, functions)
    force = {"qbar": 1, "S": 1}
    if name == "SIDE":
        # SIDE belongs to both sets of axes, so the other axes of the file decide.
        axes = "body" if names & {"AXIAL", "NORMAL"} else "wind"
        return axes, _JsbsimAxis("CY", 1.0, force, functions)
    if (name, frame) not in _FRAMES:
        allowed = (
            "DRAG SIDE LIFT, AXIAL SIDE NORMAL, X Y Z (frame BODY, STABILITY or WIND), "
            "ROLL PITCH YAW"
        )
        raise element.error(f"axis {name!r} {frame}".rstrip(), allowed)
    axes, coefficient, sign = _FRAMES[name, frame]
    return axes, _JsbsimAxis(coefficient, sign, force, functions)


def _hinge_axes(aerodynamics: Element) -> Iterator[_JsbsimAxis]:
    """Yield the hinge-moment coefficients, which `export_jsbsim` writes next to the axes."""
    for coefficient in HINGE:
        prefix = f"{COEFFICIENT}{coefficient}/"
        functions = []
        for element in aerodynamics.all("function"):
            if element.attributes.get("name", "").startswith(prefix):
                functions.append(element)
        if functions:
            yield _JsbsimAxis(coefficient, 1.0, {}, functions)


def _stated_travel(root: Element) -> dict[str, float]:
    """Return the travel of the controls in the file; empty if the control system is elsewhere."""
    control = root.first("flight_control")
    return {} if control is None else stated_travel(control)


def _title(root: Element) -> str:
    """Return the description of the file, or else its name."""
    head = root.first("fileheader")
    description = head.first("description") if head is not None else None
    if description is not None and description.text:
        return " ".join(description.text.split())
    return root.attributes.get("name", "")


def _description(function: Element) -> str:
    description = function.first("description")
    return " ".join(description.text.split()) if description is not None else ""


def _contribution_name(title: str, coefficient: str) -> str:
    """Return the name of a term of an exported file, or else the last word of the function name."""
    exported = title.removeprefix(f"{COEFFICIENT}{coefficient}/")
    return _to_word(exported if exported != title else title.rpartition("/")[2])


def _to_word(text: str) -> str:
    """Return the last part of a name with letters, digits and underscores only."""
    word = _SEPARATOR.sub("_", text.rpartition("/")[2]).strip("_")
    return word if word[:1].isalpha() else f"f_{word}".rstrip("_")


def _unused_name(name: str, leaves: Collection[str]) -> str:
    number, candidate = 1, name
    while candidate in leaves:
        number += 1
        candidate = f"{name}_{number}"
    return candidate
