"""The chapter on submodels: a section for every result that came, techniques and residuals in one table before them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.support.svg_chart import svg

from ...diagnosis import by_submodel, corrected_terms
from ...diagnosis.term_swaps import reasons
from .section import Grid, Section


def sections(
    submodels: Mapping[str, Any], free_motion: Mapping[str, Sequence[Any]], driven_motion: Mapping[str, Sequence[xr.Dataset]] | None = None
) -> list[Section]:
    """Return the sections of results by the name of the submodel.

    Raises
    ------
    SchemaError
        A result of another kind, or motion of a control that is not there.
    """
    driven = driven_motion or {}
    unknown = [
        f"{place}: {name!r} is no submodel; there are: {', '.join(submodels) or 'none'}"
        for place, motion in (("free_motion", free_motion), ("driven_motion", driven))
        for name in motion
        if name not in submodels
    ]
    found = []
    for name, result in submodels.items():
        section = _section(name, result, free_motion.get(name, ()), driven.get(name, ()))
        if section is None:
            unknown.append(
                f"submodels.{name}: {type(result).__name__}; give an EngineFit, IdentifiedLoading, GroundEffect or IdentifiedGear"
            )
        else:
            found.append(section)
    if unknown:
        raise SchemaError("report", unknown)
    return found


def _section(name: str, result: Any, free: Sequence[Any], driven: Sequence[xr.Dataset]) -> Section | None:
    """Return the section of one result; None of another kind.  What identifies them takes a second to load: most reports have none."""
    from flighttest.control_loading import IdentifiedLoading
    from flighttest.engine import EngineFit
    from flighttest.ground_effect import GroundEffect
    from flighttest.landing_gear import IdentifiedGear

    from .controls import control_loading
    from .engine import engine
    from .gear import landing_gear
    from .ground_effect import ground_effect

    if isinstance(result, EngineFit):
        return engine(name, result)
    if isinstance(result, IdentifiedLoading):
        return control_loading(name, result, free, driven)
    if isinstance(result, GroundEffect):
        return ground_effect(name, result)
    return landing_gear(name, result) if isinstance(result, IdentifiedGear) else None


def needed(diagnoses: Mapping[str, pd.DataFrame], databases: Mapping[str, xr.DataTree]) -> Grid | None:
    """Return which submodels, and what of them, the corrected model takes; None without a diagnosis."""
    if not diagnoses:
        return None
    why = reasons(diagnoses)
    taken = by_submodel(corrected_terms(diagnoses.values()), *databases.values())
    rows = tuple((submodel if k == 0 else "", name, why[name]) for submodel, names in taken.items() for k, name in enumerate(names))
    return Grid("What the corrected model takes from the final one, by submodel", ("submodel", "term or part", "why"), rows)


def context(found: Sequence[Section]) -> list[dict[str, Any]]:
    """Return what the template ``submodels.html`` shows of every section."""
    return [
        {
            "key": one.name.replace(" ", "-"),
            "name": one.name,
            "techniques": one.techniques,
            "grids": one.grids,
            "figures": [svg(p.height, p.body, p.words) for p in one.pictures],
            "remarks": one.remarks,
        }
        for one in found
    ]
