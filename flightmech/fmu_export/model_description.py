"""modelDescription.xml of FMI 2.0 and FMI 3.0.

References
----------
.. [FMI2] Functional Mock-up Interface for Model Exchange and Co-Simulation 2.0, 2014, section 2.2, 3.3 and 4.3.
.. [FMI3] Functional Mock-up Interface 3.0, 2022, section 2.4, 3.3 and 4.3.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from xml.etree import ElementTree as ET

from flightmech.errors import SchemaError
from flightmech.fmu_export.description import CHOICES, REPLAY, TIME, Description, FmuVariable
from flightmech.units import parse_unit

# relative tolerance for the importer's solver: the position is Earth-centred, 1e-9 of it are 6 mm
TOLERANCE = 1e-9

_PARTIAL = ("providesDirectionalDerivatives", "providesAdjointDerivatives")
_INTERFACES: dict[str, dict[str, tuple[str, ...]]] = {
    "2.0": {
        "ModelExchange": (
            "canNotUseMemoryManagementFunctions",
            "canGetAndSetFMUstate",
            "canSerializeFMUstate",
            "providesDirectionalDerivative",
        ),
        "CoSimulation": (
            "canHandleVariableCommunicationStepSize",
            "canInterpolateInputs",
            "canNotUseMemoryManagementFunctions",
            "canGetAndSetFMUstate",
            "canSerializeFMUstate",
            "providesDirectionalDerivative",
        ),
    },
    "3.0": {
        "ModelExchange": (
            "canGetAndSetFMUState",
            "canSerializeFMUState",
            "needsCompletedIntegratorStep",
            *_PARTIAL,
        ),
        "CoSimulation": (
            "canHandleVariableCommunicationStepSize",
            "canGetAndSetFMUState",
            "canSerializeFMUState",
            *_PARTIAL,
        ),
    },
}
_LOCAL = ("state", "derivative")


def render_model_description(description: Description, version: str) -> bytes:
    """Return modelDescription.xml for FMI `version` ``"2.0"`` or ``"3.0"``."""
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": description.title,
            "guid" if version == "2.0" else "instantiationToken": description.token,
            "description": f"Flight simulation model of {description.title}",
            "generationTool": description.tool,
            "variableNamingConvention": "structured",
        },
    )
    if version == "2.0":
        root.set("numberOfEventIndicators", "0")
    for kind, names in _INTERFACES[version].items():
        ET.SubElement(
            root, kind, {"modelIdentifier": description.identifier, **dict.fromkeys(names, "true")}
        )
    _units(root, description.variables)
    (_fmi2 if version == "2.0" else _fmi3)(root, description)
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _fmi2(root: ET.Element, description: Description) -> None:
    _experiment(root, description)
    place = {v.reference: str(i) for i, v in enumerate(description.variables, 1)}
    variables = ET.SubElement(root, "ModelVariables")
    for v in description.variables:
        scalar = ET.SubElement(variables, "ScalarVariable", _head(v))
        if (
            v.name in CHOICES
        ):  # importers that leave out enumerations, such as libcosim, know integers
            scalar.set("description", _with_choices(v.description, CHOICES[v.name]))
        if v.name in CHOICES or v.integer:
            ET.SubElement(scalar, "Integer", _integer(v, 2**31 - 1))
        else:
            ET.SubElement(
                scalar, "Real", {**_real(v), **({"derivative": place[v.state]} if v.state else {})}
            )
    structure = ET.SubElement(root, "ModelStructure")
    for part, unknowns in _parts(description, ("Outputs", "Derivatives", "InitialUnknowns")):
        element = ET.SubElement(structure, part) if unknowns else structure
        for v in unknowns:
            ET.SubElement(
                element, "Unknown", {"index": place[v.reference], **_dependencies(part, v, place)}
            )


def _fmi3(root: ET.Element, description: Description) -> None:
    types = ET.SubElement(root, "TypeDefinitions")
    for name, items in _enumerations(description):
        _items(ET.SubElement(types, "EnumerationType", name=name), items)
    _experiment(root, description)
    variables = ET.SubElement(root, "ModelVariables")
    time = {
        "name": "time",
        "valueReference": str(TIME),
        "causality": "independent",
        "variability": "continuous",
        "unit": "s",
    }
    ET.SubElement(variables, "Float64", {**time, "description": "simulated time"})
    for v in description.variables:
        if v.name in CHOICES:
            ET.SubElement(
                variables, "Enumeration", {**_head(v), "declaredType": v.name, "start": _whole(v)}
            )
        elif v.integer:
            ET.SubElement(variables, "Int64", {**_head(v), **_integer(v, 2**63 - 1)})
        else:
            ET.SubElement(
                variables,
                "Float64",
                {**_head(v), **_real(v), **({"derivative": str(v.state)} if v.state else {})},
            )
    _replay(variables, description)
    place = {v.reference: str(v.reference) for v in description.variables}
    structure = ET.SubElement(root, "ModelStructure")
    for part, unknowns in _parts(
        description, ("Output", "ContinuousStateDerivative", "InitialUnknown")
    ):
        for v in unknowns:
            ET.SubElement(
                structure,
                part,
                {"valueReference": place[v.reference], **_dependencies(part, v, place)},
            )
        if part in ("Output", "InitialUnknown"):
            ET.SubElement(structure, part, valueReference=str(REPLAY["replay.y"]))


def _replay(variables: ET.Element, description: Description) -> None:
    """Add the arrays by which a whole record is flown in one step."""
    inputs, outputs = description.of("input"), description.of("output")
    n = {
        "name": "replay.n",
        "valueReference": str(REPLAY["replay.n"]),
        "causality": "structuralParameter",
        "variability": "fixed",
    }
    ET.SubElement(
        variables,
        "UInt64",
        {**n, "description": "samples of a replay; 1: no replay", "min": "1", "start": "1"},
    )
    arrays: tuple[tuple[str, dict[str, str], int], ...] = (
        (
            "replay.t",
            {
                "unit": "s",
                "start": "0.0",
                "description": "times of the samples, rising; one step goes from the first to the "
                "last",
            },
            0,
        ),
        (
            "replay.u",
            {
                "start": " ".join(repr(v.start) for v in inputs),
                "description": "inputs of every sample, linear between them, SI; columns are the "
                "inputs in the order of this file",
            },
            len(inputs),
        ),
        (
            "replay.y",
            {
                "description": "outputs of every sample, SI; columns are the other outputs in the "
                "order of this file"
            },
            len(outputs),
        ),
    )
    for name, attributes, columns in arrays:
        kind = (
            {"causality": "output", "variability": "discrete", "initial": "calculated"}
            if name == "replay.y"
            else {}
        )
        head = {
            "name": name,
            "valueReference": str(REPLAY[name]),
            "causality": "parameter",
            "variability": "tunable",
            **kind,
        }
        array = ET.SubElement(variables, "Float64", {**head, **attributes})
        ET.SubElement(array, "Dimension", valueReference=str(REPLAY["replay.n"]))
        if columns:
            ET.SubElement(array, "Dimension", start=str(columns))


def _head(v: FmuVariable) -> dict[str, str]:
    head = {
        "name": v.name,
        "valueReference": str(v.reference),
        "description": v.description,
        "causality": "local" if v.causality in _LOCAL else v.causality,
        "variability": v.variability,
    }
    return head | ({"initial": "calculated"} if v.causality in _LOCAL else {})


def _real(v: FmuVariable) -> dict[str, str]:
    found = {"unit": v.units}
    if v.display_units != v.units:
        found["displayUnit"] = v.display_units
    for key, value in (("min", v.low), ("max", v.high), ("nominal", v.nominal), ("start", v.start)):
        if value is not None:
            found[key] = repr(value)
    return found


def _whole(v: FmuVariable) -> str:
    return str(int(v.start or 0.0))


def _integer(v: FmuVariable, most: int) -> dict[str, str]:
    limits = {
        key: str(int(min(value, most)))
        for key, value in (("min", v.low), ("max", v.high))
        if value is not None
    }
    return {**limits, "start": _whole(v)}


def _parts(
    description: Description, names: Sequence[str]
) -> Iterable[tuple[str, list[FmuVariable]]]:
    outputs, derivatives, states = (
        description.of(causality) for causality in ("output", "derivative", "state")
    )
    return zip(names, (outputs, derivatives, [*outputs, *states, *derivatives]), strict=True)


def _dependencies(part: str, v: FmuVariable, place: dict[int, str]) -> dict[str, str]:
    """Return what an unknown depends on while time runs; at the start a trim makes everything
    depend on everything.
    """
    if v.dependencies is None or part.startswith("Initial"):
        return {}
    return {"dependencies": " ".join(place[reference] for reference in v.dependencies)}


def _enumerations(description: Description) -> Iterable[tuple[str, dict[str, int]]]:
    return ((v.name, CHOICES[v.name]) for v in description.variables if v.name in CHOICES)


def _with_choices(text: str, items: dict[str, int]) -> str:
    """Return the description of a choice with its values."""
    return "; ".join(
        filter(None, [text, ", ".join(f"{value} {name}" for name, value in items.items())])
    )


def _items(parent: ET.Element, items: dict[str, int]) -> None:
    for name, value in items.items():
        ET.SubElement(parent, "Item", name=name, value=str(value))


def _experiment(root: ET.Element, description: Description) -> None:
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(
        categories,
        "Category",
        name="logStatusError",
        description="why a call was refused or failed",
    )
    ET.SubElement(
        root,
        "DefaultExperiment",
        startTime="0.0",
        tolerance=repr(TOLERANCE),
        stepSize=repr(description.step),
    )


def _units(root: ET.Element, variables: Sequence[FmuVariable]) -> None:
    """Define every unit in use by its base units, and every display unit by its factor to them."""
    used: dict[str, set[str]] = {"s": set()}
    for v in variables:
        used.setdefault(v.units, set()).add(v.display_units)
    definitions = ET.SubElement(root, "UnitDefinitions")
    for units, displays in sorted(used.items()):
        unit = ET.SubElement(definitions, "Unit", name=units)
        ET.SubElement(unit, "BaseUnit", base_units(units))
        for display in sorted(displays - {units}):
            _, factor, offset = parse_unit(
                display
            )  # SI = value * factor + offset; FMI: display = SI * factor + offset
            attributes = {"name": display, "factor": repr(1.0 / factor)}
            ET.SubElement(
                unit,
                "DisplayUnit",
                {**attributes, "offset": repr(-offset / factor)} if offset else attributes,
            )


def base_units(units: str) -> dict[str, str]:
    """Return the exponents of an SI unit as FMI names them, zeros left out.

    Examples
    --------
    >>> base_units("rad s-1")
    {'s': '-1', 'rad': '1'}
    """
    dimension, factor, offset = parse_unit(units)
    if factor != 1.0 or offset:
        raise SchemaError(
            "model description",
            [f"{units!r} is not an SI unit; the catalogue of the kernel holds SI units only"],
        )
    radians = sum(int(power or 1) for power in re.findall(r"\brad\^?(-?\d*)", units))
    exponents = dict(zip(("m", "kg", "s", "K", "rad"), (*dimension, radians), strict=True))
    return {name: str(power) for name, power in exponents.items() if power}
