"""Interface of an FMU from its description, and its comparison with the needs of a case.

An FMU is untrusted: its description is read, and its code is not run here.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from flightmech.aircraft.controls import DEVICE, ICE
from flightmech.errors import ParseError, SchemaError, UnitError, UnknownName
from flightmech.support.file_kinds import file_kind
from flightmech.support.input_files import file_sha256
from flightmech.units import parse_unit
from pom.fmu.run_cache import FileState
from pom.fmu.variable_map import Fmu, Link, Links, canonical_unit

_ABSENT = (
    "the case needs it and the FMU does not offer it; name it in a table of names, or "
    "waive an input or parameter there"
)
# Parts that give a model an input, by the beginning of its name.
_PARTS = (
    (
        re.escape(ICE),
        "the effects of ice are terms of its own; give the project the key ice, or the database "
        "with aeromatch db edit ice",
    ),
    (
        re.escape(DEVICE),
        "no term of the database depends on it; give one that does, or delete the condition",
    ),
    (
        r"crossfeed$|tank\.|transfer\.",
        "the aircraft file needs tanks in [fuel] that feed the engines, and their pumps",
    ),
)
_TEXTS = ("String", "Binary", "Clock")


def read_fmu_interface(path: str | Path) -> Fmu:
    """Read the description of an FMU; its code is not run.

    Parameters
    ----------
    path : path
        FMU of FMI 1.0, 2.0 or 3.0. Co-simulation has priority over model exchange.

    Raises
    ------
    ParseError
        The file is not an FMU, has a broken description, or only scheduled execution.
    FileNotFoundError
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(
            f"no file {str(path)!r}; give the FMU of a model, as `aeromatch fmu write` writes it"
        )
    state = FileState.of(path)
    description = _read_description_of_file(path)
    kind = description.coSimulation or description.modelExchange
    if kind is None:
        raise ParseError(
            str(path),
            0,
            f"FMI {description.fmiVersion} without co-simulation and model exchange",
            "an FMU that offers one of them",
        )
    units = _units_by_causality(description)
    is_even, step = _required_step(description)
    # Description and hash must belong to the same content.
    digest = file_sha256(path)
    if FileState.of(path) != state:
        raise ParseError(
            str(path), 0, "the file changed while it was read", "an FMU that stays as it is"
        )
    return Fmu(
        path=path.resolve(),
        version=description.fmiVersion,
        sha256=digest,
        inputs=units["input"],
        outputs=units["output"],
        parameters=units["parameter"],
        settable=units["start"],
        exchange=description.coSimulation is None,
        even=is_even,
        step=step,
        once=bool(kind.canBeInstantiatedOnlyOncePerProcess),
        state=state,
    )


def _read_description_of_file(path: Path) -> Any:
    """Return the description of an FMU; ParseError for every error of the parser."""
    # with FMPy, whose import takes a tenth of a second: a match that reuses flights reads no FMU
    from pom.fmu.worker.model import read_description

    try:
        return read_description(path)
    # FMPy raises the errors of its parsers, which have no common class.
    except Exception as error:
        content = file_kind(path)
        reason = content
        if content.startswith("a zip"):
            reason = str(error).split("\n")[0]
        raise ParseError(
            str(path), 0, reason, "an FMU (zip file with modelDescription.xml)"
        ) from error


def _units_by_causality(description: Any) -> dict[str, dict[str, str]]:
    """Return the units of the scalar numbers of an FMU, by causality and name.

    The causality ``start`` has the variables that are not parameters but have a start value.
    """
    units: dict[str, dict[str, str]] = {"input": {}, "output": {}, "parameter": {}, "start": {}}
    for variable in description.modelVariables:
        if variable.type in _TEXTS or getattr(variable, "dimensions", None):
            continue
        if variable.causality in units:
            units[variable.causality][variable.name] = _declared_unit(variable)
        # For example the initial value of a state.
        is_state = variable.causality in ("output", "local")
        if is_state and _takes_start(variable, description.fmiVersion):
            units["start"][variable.name] = _declared_unit(variable)
    return units


def demand_platform(fmu: Fmu) -> None:
    """Raise if an FMU has no library for this platform.

    Raises
    ------
    SchemaError
        With this platform, and the platforms of its libraries.
    """
    # with FMPy, as above
    from pom.fmu.worker.model import platform_problem, read_description

    problem = platform_problem(fmu.path, read_description(fmu.path))
    if problem:
        raise SchemaError(f"FMU {fmu.path}", [f"{fmu.path.name}: {problem}"])


def _declared_unit(variable: Any) -> str:
    """Return the unit of a variable, or that of its type; empty without a unit."""
    if variable.unit:
        return variable.unit
    if variable.declaredType is None:
        return ""
    return variable.declaredType.unit or ""


def _takes_start(variable: Any, version: str) -> bool:
    """Return whether the start value of a variable can be set."""
    if variable.start is None or variable.variability == "constant":
        return False
    return version.startswith("1") or variable.initial in ("exact", "approx")


def _required_step(description: Any) -> tuple[bool, float]:
    """Return whether an FMU takes only steps of one length, and the length; 0 if unknown. [s]"""
    kind, experiment = description.coSimulation, description.defaultExperiment
    # The integrator of model exchange takes steps of any length.
    if kind is None:
        return False, 0.0
    if kind.fixedInternalStepSize:
        return True, float(kind.fixedInternalStepSize)
    if kind.canHandleVariableCommunicationStepSize:
        return False, 0.0
    if experiment is None or not experiment.stepSize:
        return True, 0.0
    return True, float(experiment.stepSize)


def check_interface(
    fmu: Fmu, links: Links, inputs: Iterable[str], outputs: Iterable[str], parameters: Iterable[str]
) -> None:
    """Check that an FMU offers all that a case needs, in units that can be converted.

    Parameters
    ----------
    fmu : Fmu
    links : Links
        From `links_of`.
    inputs, outputs, parameters : iterable of str
        Canonical names.

    Raises
    ------
    SchemaError
        With every missing name, the similar names, and every foreign unit.
    """
    problems: list[str] = []
    groups = (
        ("input", inputs, links.inputs, fmu.inputs),
        ("output", outputs, links.outputs, fmu.outputs),
        ("parameter", parameters, links.parameters, fmu.parameters),
    )
    for kind, names, linked, units in groups:
        for name in names:
            if name not in linked:
                hint = _hint_of_part(name) or _ABSENT
                problems.append(str(UnknownName(name, [*linked], kind, hint)))
            # A variable with a canonical name has no entry that converts its unit.
            elif linked[name] == Link(name):
                problems += _unit_problem(kind, name, units[name])
    if problems:
        raise SchemaError(f"FMU {fmu.path}", problems)


def _hint_of_part(name: str) -> str:
    """Return which part gives a model of this product an input; empty for what all models have."""
    for pattern, part in _PARTS:
        if re.match(pattern, name):
            return (
                f"the case needs it and the FMU does not offer it: {part}; for an FMU from "
                f"elsewhere name it in a table of names, or waive it there"
            )
    return ""


@cache
def _unit_problem(kind: str, name: str, unit: str) -> tuple[str, ...]:
    """Return the problem of a declared unit that differs from the canonical unit of a name."""
    try:
        expected = canonical_unit(name)
    except UnknownName:
        return ()
    try:
        is_same = not unit or parse_unit(unit) == parse_unit(expected)
    except UnitError as error:
        return (f"{kind} {name}: {error}",)
    if is_same:
        return ()
    return (
        f"{kind} {name} is in {unit!r}; needed is {expected!r}, write the FMU in SI or give "
        f"its unit in a table of names (--names)",
    )
