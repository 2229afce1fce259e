"""What a tuning demands of its cases and of the flight evidence; known before any flight is read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

import aerodb
from flightmech.errors import SchemaError, UnknownName

from ..cases.case import PomCase


def demand_cases(cases: Sequence[PomCase], wanted: Sequence[str] | None) -> None:
    """Check that cases can be tuned.

    Raises
    ------
    UnknownName
        A wanted case that is not there.
    SchemaError
        Cases with a control law, with trim surfaces to solve for, or of one name; all of them.
    """
    names = [case.name for case in cases]
    for name in wanted or ():
        if name not in names:
            raise UnknownName(name, names, "case")
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    problems = [f"{case.name}: the kernel flies no FMU of a control law; leave the case out" for case in cases if case.law]
    solved = [case.name for case in cases if case.drive.trim_surfaces]
    problems += [f"{name}: its trim surfaces are solved for on an FMU, which tuning does not fly; leave the case out" for name in solved]
    problems += [f"{names.count(name)} cases are named {name!r}; give each a name of its own" for name in twice]
    if problems:
        raise SchemaError("cases to tune", problems)


def demand_evidence(database: xr.DataTree, evidence: xr.DataTree, rationale: Mapping[str, str]) -> None:
    """Check that the evidence bounds moves of the model.

    Raises
    ------
    UnknownName
        A term with a rationale that has no standard errors.
    SchemaError
        An evidence without standard errors, or with a table that the model does not have; a rationale without words; all of them.
    """
    model = aerodb.terms(database)
    found = {name: leaf for name, leaf in aerodb.terms(evidence).items() if "stderr" in leaf and (leaf["stderr"] > 0.0).any()}
    if not found:
        raise SchemaError("evidence", ["no term has standard errors, nothing bounds a move; give an identified database (--evidence)"])
    for name in rationale:
        if name not in found:
            raise UnknownName(name, found, "term with standard errors")
    problems = [
        f"{name}: a rationale without words; write why the term may leave the bound" for name, why in rationale.items() if not why.strip()
    ]
    other = [name for name, leaf in found.items() if name not in model or not _same_axes(leaf["value"], model[name]["value"])]
    problems += [
        f"{name}: {'the evidence has other breakpoints than the model' if name in model else 'the model has no such term'}; "
        "give the evidence on the breakpoints of the model"
        for name in other
    ]
    if problems:
        raise SchemaError("evidence", problems)


def _same_axes(one: xr.DataArray, other: xr.DataArray) -> bool:
    return one.dims == other.dims and all(np.array_equal(one[axis], other[axis]) for axis in one.dims)
