"""modelDescription.xml of FMI 2.0 and FMI 3.0, generated from the catalogue of a compiled model.

References
----------
.. [FMI2] Functional Mock-up Interface for Model Exchange and Co-Simulation 2.0, 2014, section 2.2 and 4.3.
.. [FMI3] Functional Mock-up Interface 3.0, 2022, section 2.4 and 4.3.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from .errors import SchemaError
from .units import parse

# value references: base of the kind + index in the catalogue, as in kernel/shell/fmu.h
BASE = {"input": 1000, "output": 10000, "parameter": 100000}
TIME = 0

# the values that an enumeration of the kernel can take; names as importers show them
CHOICES = {
    "mode.earth": {"flat": 0, "WGS84_rotating": 1},
    "mode.engine": {"throttle": 0, "thrust_driven": 2},
    "mode.trim": {"none": 0, "seek_thrust": 1, "seek_throttle": 2},
}

FMI2_CAPABILITIES = (
    "canHandleVariableCommunicationStepSize",
    "canInterpolateInputs",
    "canNotUseMemoryManagementFunctions",
    "canGetAndSetFMUstate",
    "canSerializeFMUstate",
)
FMI3_CAPABILITIES = ("canHandleVariableCommunicationStepSize", "canGetAndSetFMUState", "canSerializeFMUState")

_STRUCTURED = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*", re.ASCII)


@dataclass(frozen=True)
class Variable:
    """One variable of the interface; `start` is None for outputs, `low` and `high` None where there is no limit."""

    name: str
    causality: str
    reference: int
    units: str
    display_units: str
    description: str
    start: float | None = None
    low: float | None = None
    high: float | None = None
    fixed: bool = False

    @property
    def variability(self) -> str:
        """FMI word for when the value may change."""
        if self.causality == "parameter":
            return "fixed" if self.fixed else "tunable"
        return "continuous"


@dataclass(frozen=True)
class Description:
    """What both standards tell about a model; `token` ties the description to ``resources/model.bin``."""

    title: str
    identifier: str
    token: str
    tool: str
    step: float
    variables: tuple[Variable, ...]

    def __post_init__(self) -> None:
        bad = [v.name for v in self.variables if not _STRUCTURED.fullmatch(v.name)]
        if bad:
            hint = "letters, digits and underscores, parts joined by dots; rename the term"
            raise SchemaError("model description", [f"{name!r} is no FMI variable name: {hint}" for name in bad])


def identifier(title: str) -> str:
    """Return a title as a C identifier, the file name of the libraries.

    Examples
    --------
    >>> identifier("T-37B (final)")
    'T_37B_final'
    """
    word = re.sub(r"\W+", "_", title, flags=re.ASCII).strip("_")
    return word if word[:1].isalpha() else f"model_{word}".rstrip("_")


def xml(description: Description, version: str) -> bytes:
    """Return modelDescription.xml for FMI `version` ``"2.0"`` or ``"3.0"``."""
    root = _fmi2(description) if version == "2.0" else _fmi3(description)
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _root(description: Description, version: str, token: str) -> ET.Element:
    return ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": description.title,
            token: description.token,
            "description": f"Flight simulation model of {description.title}",
            "generationTool": description.tool,
            "variableNamingConvention": "structured",
        },
    )


def _capabilities(root: ET.Element, description: Description, names: Sequence[str]) -> None:
    ET.SubElement(root, "CoSimulation", {"modelIdentifier": description.identifier, **dict.fromkeys(names, "true")})


def _fmi2(description: Description) -> ET.Element:
    root = _root(description, "2.0", "guid")
    _capabilities(root, description, FMI2_CAPABILITIES)
    _units(root, description.variables)
    types = ET.SubElement(root, "TypeDefinitions")
    for name, items in _enumerations(description):
        _items(ET.SubElement(ET.SubElement(types, "SimpleType", name=name), "Enumeration"), items)
    _experiment(root, description)
    variables = ET.SubElement(root, "ModelVariables")
    for v in description.variables:
        scalar = ET.SubElement(variables, "ScalarVariable", _head(v))
        if v.name in CHOICES:
            ET.SubElement(scalar, "Enumeration", declaredType=v.name, start=str(_choice(v)))
        else:
            ET.SubElement(scalar, "Real", _real(v))
    structure = ET.SubElement(root, "ModelStructure")
    indices = [str(i) for i, v in enumerate(description.variables, 1) if v.causality == "output"]
    for part in ("Outputs", "InitialUnknowns"):
        element = ET.SubElement(structure, part)
        for index in indices:
            ET.SubElement(element, "Unknown", index=index)
    return root


def _fmi3(description: Description) -> ET.Element:
    root = _root(description, "3.0", "instantiationToken")
    _capabilities(root, description, FMI3_CAPABILITIES)
    _units(root, description.variables)
    types = ET.SubElement(root, "TypeDefinitions")
    for name, items in _enumerations(description):
        _items(ET.SubElement(types, "EnumerationType", name=name), items)
    _experiment(root, description)
    variables = ET.SubElement(root, "ModelVariables")
    time = {"name": "time", "valueReference": str(TIME), "causality": "independent", "variability": "continuous", "unit": "s"}
    ET.SubElement(variables, "Float64", {**time, "description": "simulated time"})
    for v in description.variables:
        if v.name in CHOICES:
            ET.SubElement(variables, "Enumeration", {**_head(v), "declaredType": v.name, "start": str(_choice(v))})
        else:
            ET.SubElement(variables, "Float64", {**_head(v), **_real(v)})
    structure = ET.SubElement(root, "ModelStructure")
    references = [str(v.reference) for v in description.variables if v.causality == "output"]
    for part in ("Output", "InitialUnknown"):
        for reference in references:
            ET.SubElement(structure, part, valueReference=reference)
    return root


def _head(v: Variable) -> dict[str, str]:
    return {
        "name": v.name,
        "valueReference": str(v.reference),
        "description": v.description,
        "causality": v.causality,
        "variability": v.variability,
    }


def _real(v: Variable) -> dict[str, str]:
    found = {"unit": v.units}
    if v.display_units != v.units:
        found["displayUnit"] = v.display_units
    for key, value in (("min", v.low), ("max", v.high), ("start", v.start)):
        if value is not None:
            found[key] = repr(value)
    return found


def _choice(v: Variable) -> int:
    return int(v.start or 0.0)


def _enumerations(description: Description) -> Iterable[tuple[str, dict[str, int]]]:
    return ((v.name, CHOICES[v.name]) for v in description.variables if v.name in CHOICES)


def _items(parent: ET.Element, items: dict[str, int]) -> None:
    for name, value in items.items():
        ET.SubElement(parent, "Item", name=name, value=str(value))


def _experiment(root: ET.Element, description: Description) -> None:
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="why a call was refused or failed")
    ET.SubElement(root, "DefaultExperiment", startTime="0.0", stepSize=repr(description.step))


def _units(root: ET.Element, variables: Sequence[Variable]) -> None:
    """Define every unit in use by its base units, and every display unit by its factor to them."""
    used: dict[str, set[str]] = {"s": set()}
    for v in variables:
        used.setdefault(v.units, set()).add(v.display_units)
    definitions = ET.SubElement(root, "UnitDefinitions")
    for units, displays in sorted(used.items()):
        unit = ET.SubElement(definitions, "Unit", name=units)
        ET.SubElement(unit, "BaseUnit", base_units(units))
        for display in sorted(displays - {units}):
            _, factor, offset = parse(display)  # SI = value * factor + offset; FMI: display = SI * factor + offset
            attributes = {"name": display, "factor": repr(1.0 / factor)}
            ET.SubElement(unit, "DisplayUnit", {**attributes, "offset": repr(-offset / factor)} if offset else attributes)


def base_units(units: str) -> dict[str, str]:
    """Return the exponents of an SI unit as FMI names them, zeros left out.

    Examples
    --------
    >>> base_units("rad s-1")
    {'s': '-1', 'rad': '1'}
    """
    dimension, factor, offset = parse(units)
    if factor != 1.0 or offset:
        raise SchemaError("model description", [f"{units!r} is not an SI unit; the catalogue of the kernel holds SI units only"])
    radians = sum(int(power or 1) for power in re.findall(r"\brad\^?(-?\d*)", units))
    exponents = dict(zip(("m", "kg", "s", "K", "rad"), (*dimension, radians), strict=True))
    return {name: str(power) for name, power in exponents.items() if power}


def no_limit(value: float) -> bool:
    """Tell whether a catalogue limit means none."""
    return abs(value) >= sys.float_info.max
