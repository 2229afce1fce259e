"""The aerodynamics of a JSBSim aircraft file as a database.

Read are functions that are sums of products of numbers, properties and tables of one to four axes,
on the axes ``DRAG SIDE LIFT`` (wind), ``AXIAL SIDE NORMAL`` (body), ``X Y Z`` with a frame, and
``ROLL PITCH YAW`` (body).  Degrees become radians, feet metres, and a rate times ``bi2vel`` or
``ci2vel`` a reduced rate.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from aerodb.exchange.jsbsim.functions import Functions, sample_product
from aerodb.exchange.jsbsim.products import NotAProduct, scale_products
from aerodb.exchange.jsbsim.properties import COEFFICIENT, stated_travel
from aerodb.exchange.jsbsim.terms import term_of_product
from aerodb.exchange.xml_reader import Element, read_xml
from aerodb.store.schema import HINGE, make_database
from flightmech.errors import SchemaError, UnknownName
from flightmech.units import FOOT, INCH

_LENGTH = {"FT": FOOT, "M": 1.0, "IN": INCH}
_AREA = {"FT2": FOOT**2, "M2": 1.0}
_FRAMES = {
    ("LIFT", ""): ("wind", "CL", 1.0),
    ("DRAG", ""): ("wind", "CD", 1.0),
    ("AXIAL", ""): ("body", "CX", -1.0),
    ("NORMAL", ""): ("body", "CZ", -1.0),
    **{(axis, frame): ("body", f"C{axis}", 1.0) for axis in "XYZ" for frame in ("", "BODY")},
    # JSBSim turns the signs of X and Z of these frames round: they are drag and lift
    **{
        (axis, frame.upper()): (frame, name, 1.0)
        for frame in ("stability", "wind")
        for axis, name in (("X", "CD"), ("Y", "CY"), ("Z", "CL"))
    },
}
_TAIL = {
    "htailarea": "metrics/Sh-sqft",
    "htailarm": "metrics/lh-ft",
    "vtailarea": "metrics/Sv-sqft",
    "vtailarm": "metrics/lv-ft",
}
_MOMENTS = {"ROLL": ("Cl", "b"), "PITCH": ("Cm", "cbar"), "YAW": ("Cn", "b")}
_AILERONS = "both ailerons are taken to move by the same angle, left = -delta_a and right = delta_a"
_WORD = re.compile(r"[^A-Za-z0-9_]+")


@dataclass(frozen=True)
class _JsbsimAxis:
    """An axis of the file: the coefficient, its sign there and what a coefficient is multiplied by."""

    coefficient: str
    sign: float
    per: Mapping[str, int]
    functions: list[Element]


def import_jsbsim(
    path: str | os.PathLike,
    *,
    travel: Mapping[str, float] | None = None,
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
        Deflection where a normalised position is 1, ``{"delta_f": 0.698}`` for
        ``fcs/flap-pos-norm``; what the control system of the file states by scaling a position to
        its fraction needs no entry. [rad]
    leave_out : collection of str, optional
        Names of functions to do without; they are listed in ``absent``.
    sample : float, optional
        Largest difference with which a function that is no product of tables may be put onto one
        table; without it such functions are refused.  [1, or per unit of the regressors]
    box : mapping of str to (low, high), optional
        Range of variables for `sample`; without an entry, the range of the tables over it. [SI]

    Returns
    -------
    DataTree
        A database in the force axes of the file; terms carry the names of the functions,
        ``CL/CLalpha``, and those of `export_jsbsim` their own.  Moment reference is ``AERORP``.

    Raises
    ------
    ParseError
        Not an aircraft file, a faulty table, an unknown unit; with the line.
    SchemaError
        With every function that is no term, and why.
    UnknownName
        A name in `leave_out` that the file does not have.

    Notes
    -----
    ``aero/cl-squared`` is ``CL CL``, the lift coefficient of the same instant; JSBSim takes the lift of the step before over the present
    dynamic pressure.  Ailerons are taken to move by the same angle: ``left-aileron-pos`` is -delta_a.  Magnitudes such as
    ``aero/mag-beta-rad``, and a third factor such as ``gear-pos-norm``, become tables over all values of the variable.
    """
    root = read_xml(Path(path))
    if root.tag != "fdm_config":
        raise root.error(f"<{root.tag}>", "an aircraft file of JSBSim, <fdm_config>")
    metrics, aerodynamics = (_section(root, tag) for tag in ("metrics", "aerodynamics"))
    sizes = _sizes(metrics)
    force_axes, axes = _axes(aerodynamics)
    named = {
        name: element
        for element in aerodynamics.walk()
        if element.tag == "function" and (name := element.attributes.get("name", ""))
    }
    for name in leave_out:
        if name not in named:
            raise UnknownName(name, named, "function")
    in_feet = {"S": sizes["S"] / FOOT**2, "cbar": sizes["cbar"] / FOOT, "b": sizes["b"] / FOOT}
    functions = Functions(
        named, in_feet, {**_stated_travel(root), **(travel or {})}, _tail(metrics)
    )
    leaves, problems = _leaves(axes, functions, leave_out, sample, box or {})
    if problems:
        raise SchemaError(
            f"{path}: functions that are no terms; leave_out = [names] does without them, "
            f"sample = bound tabulates what can be",
            problems,
        )
    return make_database(
        leaves,
        title=_title(root),
        aircraft=root.attributes.get("name", "") or Path(path).stem,
        **sizes,
        **_reference(metrics),
        force_axes=force_axes,
        source=f"JSBSim aircraft file {Path(path).name}",
        history=f"import_jsbsim: {Path(path).name}",
        comment=_AILERONS
        if any("aileron-pos" in e.text for axis in axes for f in axis.functions for e in f.walk())
        else "",
        absent=" ".join(
            f"{axis.coefficient}/{_word(name)}"
            for axis in axes
            for name in _left_out(axis, leave_out)
        ),
    )


def _leaves(
    axes: list[_JsbsimAxis],
    functions: Functions,
    leave_out: Collection[str],
    sample: float | None,
    box: Mapping[str, tuple[float, float]],
) -> tuple[dict[str, xr.Dataset], list[str]]:
    """Return the terms by name, and a problem for each function that is none."""
    leaves: dict[str, xr.Dataset] = {}
    problems = []
    for axis in axes:
        for element in axis.functions:
            title = element.attributes.get("name", "")
            if title in leave_out:
                continue
            text = {
                "comment": _description(element),
                "references": f"{Path(element.file).name}, line {element.line}, {title}",
            }
            text["history"] = f"import_jsbsim: {Path(element.file).name}"
            try:
                for product in scale_products(axis.sign, functions.products(element)):
                    found = term_of_product(
                        product,
                        axis.per,
                        functions.sizes,
                        lambda opaque, tables: sample_product(opaque, tables, sample, box),
                        **text,
                    )
                    leaves[
                        _free(
                            f"{axis.coefficient}/{_contribution(title, axis.coefficient)}", leaves
                        )
                    ] = found
            except NotAProduct as reason:
                problems.append(f"line {element.line}: {title or 'function'}: {reason}")
            except SchemaError as error:
                problems += [
                    f"line {element.line}: {title or 'function'}: {reason}"
                    for reason in error.problems
                ]
    return leaves, problems


def _axes(aerodynamics: Element) -> tuple[str, list[_JsbsimAxis]]:
    """Return the force axes of the file and its axes, hinge moments behind them."""
    frames: dict[str, Element] = {}
    found: list[_JsbsimAxis] = []
    elements = aerodynamics.all("axis")
    names = {element.attributes.get("name", "") for element in elements}
    for element in elements:
        if element.attributes.get("unit", "LBS") not in ("LBS", "LBSFT"):
            raise element.error(
                f"unit {element.attributes['unit']!r}",
                "forces in LBS and moments in LBSFT, as JSBSim takes them",
            )
        frame, axis = _axis(element, names)
        if axis.coefficient in {other.coefficient for other in found}:
            raise element.error(
                f"a second axis {element.attributes['name']}",
                "each axis once; JSBSim keeps the last one only, join them",
            )
        found.append(axis)
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
    return next(iter(frames), "wind"), [*found, *_hinges(aerodynamics)]


def _axis(element: Element, names: set[str]) -> tuple[str, _JsbsimAxis]:
    """Return the frame of the forces ("" for moments) and the axis."""
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
    if name == "SIDE":
        side = "body" if names & {"AXIAL", "NORMAL"} else "wind"
        return side, _JsbsimAxis("CY", 1.0, {"qbar": 1, "S": 1}, functions)
    if (name, frame) not in _FRAMES:
        allowed = (
            "DRAG SIDE LIFT, AXIAL SIDE NORMAL, X Y Z (frame BODY, STABILITY or WIND), "
            "ROLL PITCH YAW"
        )
        raise element.error(f"axis {name!r} {frame}".rstrip(), allowed)
    axes, coefficient, sign = _FRAMES[name, frame]
    return axes, _JsbsimAxis(coefficient, sign, {"qbar": 1, "S": 1}, functions)


def _hinges(aerodynamics: Element) -> Iterator[_JsbsimAxis]:
    """Yield the hinge-moment coefficients that `export_jsbsim` writes next to the axes."""
    for coefficient in HINGE:
        named = [
            e
            for e in aerodynamics.all("function")
            if e.attributes.get("name", "").startswith(f"{COEFFICIENT}{coefficient}/")
        ]
        if named:
            yield _JsbsimAxis(coefficient, 1.0, {}, named)


def _stated_travel(root: Element) -> dict[str, float]:
    """Return the travel of the controls that the file states; of one whose control system is
    elsewhere, none.
    """
    control = root.first("flight_control")
    return {} if control is None else stated_travel(control)


def _section(root: Element, tag: str) -> Element:
    """Return a section, from its own file in the folder of the aircraft file where it refers to
    one.
    """
    element = root.first(tag)
    if element is None:
        raise root.error(f"no <{tag}>", f"an aircraft file with <{tag}>")
    name = element.attributes.get("file", "")
    if not name:
        return element
    folder = Path(root.file).resolve().parent
    for candidate in (
        folder / name,
        folder / f"{name}.xml",
        folder / "Systems" / name,
        folder / "Systems" / f"{name}.xml",
    ):
        if candidate.is_file() and candidate.resolve().is_relative_to(folder):
            found = read_xml(candidate)
            if found.tag != tag:
                raise found.error(
                    f"<{found.tag}>",
                    f"<{tag}>, which {Path(root.file).name} refers to in line {element.line}",
                )
            return found
    raise element.error(
        f"file {name!r}", f"a file in the folder of {Path(root.file).name}; put it there"
    )


def _sizes(metrics: Element) -> dict[str, float]:
    """Return ``S``, ``cbar`` and ``b``. [m2, m, m]"""
    rows = {
        "S": ("wingarea", "FT2", _AREA),
        "cbar": ("chord", "FT", _LENGTH),
        "b": ("wingspan", "FT", _LENGTH),
    }
    return {
        name: _measure(metrics, tag, default, units) for name, (tag, default, units) in rows.items()
    }


def _tail(metrics: Element) -> dict[str, float]:
    """Return the areas and arms of the tail by property. [ft2, ft]"""
    found = {}
    for tag, name in _TAIL.items():
        element = metrics.first(tag)
        if element is not None:
            area = tag.endswith("area")
            units, default = (_AREA, "FT2") if area else (_LENGTH, "FT")
            found[name] = element.number * _unit(element, default, units) / units[default]
    return found


def _measure(parent: Element, tag: str, default: str, units: Mapping[str, float]) -> float:
    element = parent.first(tag)
    if element is None:
        raise parent.error(
            f"<{parent.tag}> without <{tag}>", f"<{tag}> with a unit, {' or '.join(units)}"
        )
    if element.number <= 0.0:
        raise element.error(f"<{tag}> {element.number:g}", "a positive number")
    return element.number * _unit(element, default, units)


def _unit(element: Element, default: str, units: Mapping[str, float]) -> float:
    name = element.attributes.get("unit", default)
    if name not in units:
        raise element.error(f"unit {name!r} of <{element.tag}>", f"one of {', '.join(units)}")
    return units[name]


def _reference(metrics: Element) -> dict[str, float]:
    """Return the moment reference point, body directions, from structural axes: x aft, z up. [m]"""
    for location in metrics.all("location"):
        if location.attributes.get("name") == "AERORP":
            scale = _unit(location, "IN", _LENGTH)
            found = {}
            for axis, sign in zip("xyz", (-1.0, 1.0, -1.0)):
                element = location.first(axis)
                if element is None:
                    raise location.error(f"AERORP without <{axis}>", "x, y and z")
                found[f"{axis}_ref"] = sign * element.number * scale
            return found
    raise metrics.error(
        "no location AERORP", "the moment reference point, <location name='AERORP'>"
    )


def _title(root: Element) -> str:
    head = root.first("fileheader")
    description = head.first("description") if head is not None else None
    return (
        " ".join(description.text.split())
        if description is not None and description.text
        else root.attributes.get("name", "")
    )


def _description(function: Element) -> str:
    found = function.first("description")
    return " ".join(found.text.split()) if found is not None else ""


def _contribution(title: str, coefficient: str) -> str:
    """Return the name of a term: ours as it was written, else the last word of the function's name."""
    own = title.removeprefix(f"{COEFFICIENT}{coefficient}/")
    return _word(own if own != title else title.rpartition("/")[2])


def _word(text: str) -> str:
    word = _WORD.sub("_", text.rpartition("/")[2]).strip("_")
    return word if word[:1].isalpha() else f"f_{word}".rstrip("_")


def _free(name: str, taken: Collection[str]) -> str:
    number, found = 1, name
    while found in taken:
        number += 1
        found = f"{name}_{number}"
    return found


def _left_out(axis: _JsbsimAxis, leave_out: Collection[str]) -> list[str]:
    return [
        title
        for function in axis.functions
        if (title := function.attributes.get("name", "")) in leave_out
    ]
