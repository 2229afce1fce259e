"""Elements of JSBSim files that `export_jsbsim` writes.

A file of JSBSim is a program: its elements write files, open sockets, and read other files. Before
the file of another person is flown, all elements and attributes are removed that the exporter does
not write.
"""

from __future__ import annotations

from xml.etree import ElementTree as ET

_FUNCTION = ("description", "property", "value", "table")
_OPERATIONS = ("product", "sum", "difference", "quotient", "max", "interpolate1d")
_OPERANDS = (*_FUNCTION, *_OPERATIONS)
_POSITION = ("x", "y", "z")
# Parent element: its children.
_CHILDREN: dict[str, tuple[str, ...]] = {
    "fdm_config": (
        "fileheader",
        "metrics",
        "mass_balance",
        "ground_reactions",
        "external_reactions",
        "flight_control",
        "aerodynamics",
    ),
    "fileheader": ("author", "description", "note", "reference"),
    "metrics": ("wingarea", "wingspan", "chord", "location"),
    "mass_balance": ("ixx", "iyy", "izz", "ixy", "ixz", "iyz", "emptywt", "location"),
    "external_reactions": ("force",),
    "force": ("function", "location", "direction"),
    "location": _POSITION,
    "direction": _POSITION,
    "flight_control": ("property", "channel"),
    "channel": ("aerosurface_scale", "fcs_function", "pure_gain", "lag_filter"),
    "aerosurface_scale": ("input", "domain", "zero_centered", "range", "output"),
    "domain": ("min", "max"),
    "range": ("min", "max"),
    "fcs_function": ("function",),
    "pure_gain": ("input", "gain", "output"),
    "lag_filter": ("input", "c1", "output"),
    "aerodynamics": ("function", "axis"),
    "axis": ("function",),
    "function": _OPERANDS,
    **dict.fromkeys(_OPERATIONS, _OPERANDS),
    "table": ("independentVar", "tableData"),
    "tableData": ("tableData",),
}
# Attributes of an element; every other attribute is removed, such as the name of a file.
_ATTRIBUTES: dict[str, tuple[str, ...]] = {
    "fdm_config": ("name", "version", "release"),
    "reference": ("author", "date", "title", "refID"),
    "mass_balance": ("negated_crossproduct_inertia",),
    "location": ("name", "unit"),
    "force": ("name", "frame"),
    "flight_control": ("name",),
    "property": ("value",),
    "axis": ("name", "frame"),
    "function": ("name", "type"),
    "independentVar": ("lookup",),
    "tableData": ("breakPoint",),
    **dict.fromkeys(("channel", "aerosurface_scale", "fcs_function"), ("name",)),
    **dict.fromkeys(("pure_gain", "lag_filter"), ("name",)),
    **dict.fromkeys(("wingarea", "wingspan", "chord", "emptywt"), ("unit",)),
    **dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), ("unit",)),
}


def keep_written_elements(root: ET.Element) -> list[str]:
    """Remove from a model all elements and attributes that the exporter does not write.

    Returns
    -------
    list of str
        What was removed, each once, as ``parent/element`` or ``element@attribute``.
    """
    removed: dict[str, None] = {}
    waiting = [root]
    while waiting:
        element = waiting.pop()
        allowed = _CHILDREN.get(element.tag, ())
        for name in list(element.attrib):
            if name not in _ATTRIBUTES.get(element.tag, ()):
                del element.attrib[name]
                removed[_short(f"{element.tag}@{name}")] = None
        for child in list(element):
            if child.tag in allowed:
                waiting.append(child)
            else:
                element.remove(child)
                removed[_short(f"{element.tag}/{child.tag}")] = None
    return list(removed)


def _short(text: str) -> str:
    """Return a foreign name as a part of a message."""
    return "".join(item if item.isprintable() else " " for item in text[:80])
