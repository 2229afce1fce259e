"""Sections on submodels in page and PDF: one per submodel, and the table of what is needed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.support.figures import make_svg_figure
from flighttest.submodels.control_loading.result import IdentifiedLoading
from flighttest.submodels.engine.propellers.result import PropellerFit
from flighttest.submodels.engine.result import EngineFit
from flighttest.submodels.ground_effect.result import GroundEffect
from flighttest.submodels.landing_gear.result import IdentifiedGear
from flighttest.submodels.stall.result import StallIdentification
from pom.diagnosis.corrected_model import corrected_terms, correction_reasons
from pom.diagnosis.term_swaps import by_submodel
from pom.report.submodels.control_loading import control_loading
from pom.report.submodels.engine import engine_section
from pom.report.submodels.envelope import NAME as ENVELOPE
from pom.report.submodels.ground_effect import ground_effect_section
from pom.report.submodels.landing_gear import landing_gear
from pom.report.submodels.propeller import propeller_section
from pom.report.submodels.section import Section, SectionTable
from pom.report.submodels.stall import stall_section


def make_sections(
    submodels: Mapping[str, Any],
    free_motion: Mapping[str, Sequence[Any]],
    driven_motion: Mapping[str, Sequence[xr.Dataset]] | None = None,
) -> list[Section]:
    """Return the section of every submodel.

    Parameters
    ----------
    submodels : mapping of str to EngineFit, PropellerFit, IdentifiedLoading, GroundEffect, \
StallIdentification or IdentifiedGear
        Result of the identification, by name of the submodel.
    free_motion : mapping of str to sequence of SimulatedWindow
        Simulated free motion of controls, by name of the submodel.
    driven_motion : mapping of str to sequence of Dataset (time,), optional
        Records of the slow motion of controls, by name of the submodel.

    Raises
    ------
    SchemaError
        A result of another type, or motion of a submodel that is not in `submodels`.
    """
    driven_motion = driven_motion or {}
    problems = []
    for argument, motion in (("free_motion", free_motion), ("driven_motion", driven_motion)):
        for name in motion:
            if name not in submodels:
                problems.append(
                    f"{argument}: {name!r} is not a submodel; "
                    f"there are: {', '.join(submodels) or 'none'}"
                )
    sections = []
    for name, result in submodels.items():
        section = _make_section(
            name, result, free=free_motion.get(name, ()), driven=driven_motion.get(name, ())
        )
        if section is None:
            problems.append(
                f"submodels.{name}: {type(result).__name__}; give an EngineFit, "
                f"PropellerFit, IdentifiedLoading, GroundEffect, StallIdentification or "
                f"IdentifiedGear"
            )
        else:
            sections.append(section)
    # All problems are raised together.
    if problems:
        raise SchemaError("report", problems)
    return sections


def _make_section(
    name: str, result: Any, free: Sequence[Any], driven: Sequence[xr.Dataset]
) -> Section | None:
    """Return the section of one result; None if its type is unknown."""
    if isinstance(result, EngineFit):
        return engine_section(name, result)
    if isinstance(result, PropellerFit):
        return propeller_section(name, result)
    if isinstance(result, IdentifiedLoading):
        return control_loading(name, result, free, driven)
    if isinstance(result, GroundEffect):
        return ground_effect_section(name, result)
    if isinstance(result, StallIdentification):
        return stall_section(name, result)
    if isinstance(result, IdentifiedGear):
        return landing_gear(name, result)
    return None


def needed_submodels(
    diagnoses: Mapping[str, pd.DataFrame], databases: Mapping[str, xr.DataTree]
) -> SectionTable | None:
    """Return the terms that the corrected model takes from the final one, by submodel.

    None without a diagnosis.
    """
    if not diagnoses:
        return None
    reasons = correction_reasons(diagnoses)
    corrected = by_submodel(corrected_terms(diagnoses.values()), *databases.values())
    rows = []
    for submodel, terms in corrected.items():
        # The name of the submodel is printed once, in the row of its first term.
        label = submodel
        for term in terms:
            rows.append((label, term, reasons[term]))
            label = ""
    return SectionTable(
        "What the corrected model takes from the final one, by submodel",
        ("submodel", "term or part", "why"),
        tuple(rows),
    )


def chapter_title(sections: Sequence[Section]) -> str:
    """Return the heading of the chapter; the validity envelope is not identified by itself."""
    names = {section.name for section in sections}
    if names == {ENVELOPE}:
        return "Validity envelope of the identified model"
    if ENVELOPE in names:
        return "Submodels identified from flight, and validity envelope"
    return "Submodels identified from flight"


def identified_names(sections: Sequence[Section]) -> str:
    """Return the submodels that the chapter has, in its order, without the validity envelope."""
    return ", ".join(section.name for section in sections if section.name != ENVELOPE)


def submodels_context(sections: Sequence[Section]) -> list[dict[str, Any]]:
    """Return the data of every section for the template ``submodels.html``."""
    return [_section_context(section) for section in sections]


def _section_context(section: Section) -> dict[str, Any]:
    figures = [make_svg_figure(p.height, p.body, p.words) for p in section.pictures]
    return {
        "key": section.name.replace(" ", "-"),
        "name": section.name,
        "techniques": section.techniques,
        "grids": section.grids,
        "figures": figures,
        "remarks": section.remarks,
    }
