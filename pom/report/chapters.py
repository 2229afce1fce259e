"""Chapters of a report in addition to its cases: databases, identification, submodels.

The chapters are made from databases of 12 MB and fits of 50 MB and more, which a report does not
hold.  ``results.nc`` stores the chapters as they are drawn.  A report can so be written again with
its chapters, without these files.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, TypedDict

import pandas as pd
import xarray as xr

from flightmech.envelope.maps import RegionMap
from flightmech.errors import SchemaError
from flightmech.support.console import to_json_types
from flighttest.regression.equation_error.fit import Fit
from pom.diagnosis.culprits.project_ranking import CAPTION, COLUMNS, ProjectRanking
from pom.report.case.page import run_line_classes
from pom.report.models.database_comparison import compare_for_report
from pom.report.models.identification import identification_chapter
from pom.report.submodels.envelope import final_maps, restored_map
from pom.report.submodels.section import Picture, Section, SectionTable
from pom.report.submodels.sections import make_sections, needed_submodels

CHAPTERS = ("identification", "database")
"""Chapters of the PDF that are printed on request."""

# Attributes of a database that the report prints.
_ATTRIBUTES = ("title", "aircraft", "source", "absent", "notices")
# Classes that are stored, by name, and the key that holds the name.
_KINDS = {kind.__name__: kind for kind in (Picture, Section, SectionTable, RegionMap)}
_KIND = "of"


class ReportEvidence(TypedDict, total=False):
    """Data behind the results of a report, from which its chapters are drawn; all optional.

    Attributes
    ----------
    databases : mapping of str to DataTree
        Aerodynamic databases to compare, the prior first.  Databases named after runs have the
        line style of the runs.
    diagnoses : mapping of str to DataFrame
        Case name to the table of `pom.diagnose`.
    support : mapping of str to DataFrame
        Term (``CL/basic``) to the flight samples that support it.  The columns are named after the
        axes of the term. [SI]
    fits : sequence of flighttest.Fit
        Local models of the identification.  The page shows their estimates, residuals and
        collinearity.
    submodels : mapping of str to EngineFit, IdentifiedLoading, GroundEffect or IdentifiedGear
        Submodels identified from flight, by name, for a chapter of page and PDF.
    free_motion : mapping of str to sequence of SimulatedWindow
        Simulated free motion of a control, by submodel.
    driven_motion : mapping of str to sequence of Dataset (time,)
        Records of the slow motion of a control, by submodel.  Their force is drawn over the travel.
    tunings : mapping of str to mapping
        Log of the tuning (`pom.diagnosis.tuning.tuning_log.read_log`) by model name, for a chapter
        of page and PDF.
    level_lines : mapping of str to Dataset (mach,)
        1 g lines of the map of the flights, from `aerodb.figures.one_g_lines`.
    kept : bytes or Chapters
        Chapters of an earlier report (`Archive.chapters`), or of `draw_chapters`.  They replace
        `databases`, `fits` and `submodels` where these are not given.
    """

    databases: Mapping[str, xr.DataTree] | None
    diagnoses: Mapping[str, pd.DataFrame] | None
    support: Mapping[str, pd.DataFrame] | None
    fits: Sequence[Fit]
    submodels: Mapping[str, Any] | None
    free_motion: Mapping[str, Sequence[Any]] | None
    driven_motion: Mapping[str, Sequence[xr.Dataset]] | None
    tunings: Mapping[str, Mapping[str, Any]] | None
    level_lines: Mapping[str, xr.Dataset] | None
    kept: bytes | Chapters


@dataclass(frozen=True)
class Chapters:
    """Content of a report in addition to its cases.

    Attributes
    ----------
    databases : dict of str to dict
        Title, aircraft, source and absent terms of the databases, by name.
    compared : dict or None
        Result of `database_comparison.compare_for_report`.
    identification : dict or None
        Result of `identification.identification_chapter`.
    submodels : tuple of Section
    needed : SectionTable or None
        Terms that the corrected model takes from the final one.
    on_paper : tuple of str
        Chapters of the PDF, of `CHAPTERS`.
    ranking : SectionTable or None
        Terms of the a-priori model ranked over all cases.
    ranking_text : tuple of str
        What the ranking states, in sentences.
    maps : tuple of RegionMap
        Maps of the validity envelope of the last database.
    """

    databases: dict[str, dict[str, str]]
    compared: dict[str, Any] | None = None
    identification: dict[str, Any] | None = None
    submodels: tuple[Section, ...] = ()
    needed: SectionTable | None = None
    on_paper: tuple[str, ...] = ()
    ranking: SectionTable | None = None
    ranking_text: tuple[str, ...] = ()
    maps: tuple[RegionMap, ...] = ()

    @property
    def roots(self) -> dict[str, xr.DataTree]:
        """The databases without their terms."""
        roots = {}
        for name, attrs in self.databases.items():
            roots[name] = xr.DataTree(xr.Dataset(attrs=dict(attrs)))
        return roots

    def kept(self) -> bytes:
        """Return the chapters as ``results.nc`` stores them; empty without chapters."""
        if not (self.databases or self.identification or self.submodels):
            return b""
        text = json.dumps(
            _to_plain(self), ensure_ascii=False, sort_keys=True, separators=(",", ":")
        )
        return text.encode()


def draw_chapters(
    databases: Mapping[str, xr.DataTree],
    support: Mapping[str, pd.DataFrame],
    fits: Sequence[Fit],
    level_lines: Mapping[str, xr.Dataset],
    submodels: Sequence[Section],
    diagnoses: Mapping[str, pd.DataFrame],
    on_paper: Sequence[str],
    ranking: ProjectRanking | None = None,
) -> Chapters:
    """Return the chapters made from arguments of `pom.write_report`.

    Parameters
    ----------
    databases, support, fits, level_lines, diagnoses
        As in `ReportEvidence`.
    submodels : sequence of Section
        Sections on the submodels (`make_sections`).
    on_paper : sequence of str
        Chapters of the PDF.  The figures of fits are drawn for paper only if it has them.
    ranking : ProjectRanking, optional
        The terms ranked over all cases.
    """
    attributes: dict[str, dict[str, str]] = {}
    for name, db in databases.items():
        attributes[name] = {key: str(db.attrs[key]) for key in _ATTRIBUTES if key in db.attrs}
    # A chapter without data is absent.
    compared = identification = needed = None
    if databases:
        compared = compare_for_report(databases, support, run_line_classes(databases))
    if fits:
        identification = identification_chapter(fits, level_lines, "identification" in on_paper)
    if submodels:
        needed = needed_submodels(diagnoses, databases)
    ranked: SectionTable | None = None
    text: tuple[str, ...] = ()
    if ranking is not None:
        ranked = SectionTable(CAPTION, COLUMNS, tuple(ranking.rows()))
        text = tuple(ranking.sentences)
    return Chapters(
        attributes,
        compared,
        identification=identification,
        submodels=tuple(submodels),
        needed=needed,
        on_paper=tuple(on_paper),
        ranking=ranked,
        ranking_text=text,
        maps=final_maps(databases),
    )


def drawn_chapters(
    *,
    databases: Mapping[str, xr.DataTree],
    diagnoses: Mapping[str, pd.DataFrame],
    fits: Sequence[Fit],
    submodels: Mapping[str, Any],
    free_motion: Mapping[str, Sequence[Any]],
    driven_motion: Mapping[str, Sequence[xr.Dataset]],
    chapters: Sequence[str],
    level_lines: Mapping[str, xr.Dataset],
    ranking: ProjectRanking | None = None,
) -> Chapters:
    """Return the chapters for the argument `kept` of `pom.write_report`.

    The arguments are those of `pom.write_report`, which then writes the same report without them,
    and the ranking of the terms over all cases.
    """
    return draw_chapters(
        databases,
        {},
        fits=fits,
        level_lines=level_lines,
        submodels=make_sections(submodels, free_motion, driven_motion),
        diagnoses=diagnoses,
        on_paper=chapters,
        ranking=ranking,
    )


def restore_chapters(kept: bytes) -> Chapters:
    """Return the chapters from the bytes of `Chapters.kept`."""
    items = _from_plain(json.loads(kept)) if kept else {}
    return Chapters(
        items.get("databases", {}),
        items.get("compared"),
        identification=items.get("identification"),
        submodels=tuple(items.get("submodels", ())),
        needed=items.get("needed"),
        on_paper=tuple(items.get("on_paper", ())),
        ranking=items.get("ranking"),
        ranking_text=tuple(items.get("ranking_text", ())),
        maps=tuple(restored_map(own) for own in items.get("maps", ())),
    )


def with_kept(now: Chapters, before: Chapters, on_paper: Sequence[str] | None = None) -> Chapters:
    """Return the chapters of this report, completed by those of an earlier one.

    Parameters
    ----------
    now, before : Chapters
        Chapters of this report and of the earlier one.
    on_paper : sequence of str, optional
        Chapters of the PDF.  The default is the selection of the earlier report.

    Raises
    ------
    SchemaError
        Neither report has a chapter of the PDF.
    """
    printed = before.on_paper if on_paper is None else tuple(on_paper)
    chapters = replace(now, on_paper=printed)
    if not now.databases:
        chapters = replace(
            chapters, databases=before.databases, compared=before.compared, maps=before.maps
        )
    if not now.identification:
        chapters = replace(chapters, identification=before.identification)
    if not now.submodels:
        chapters = replace(chapters, submodels=before.submodels, needed=before.needed)
    if not now.ranking:
        chapters = replace(chapters, ranking=before.ranking, ranking_text=before.ranking_text)
    # Figures of fits are stored only if the earlier report printed them.
    fits = chapters.identification["fits"] if chapters.identification else []
    lacking = []
    if "identification" in printed and not any(fit.get("drawing") for fit in fits):
        lacking.append(
            "identification: the results hold no figures of it; match again with it among "
            "the chapters of the project"
        )
    if "database" in printed and not chapters.compared:
        lacking.append(
            "database: the results compare no databases; give them as --database NAME=FILE.nc"
        )
    if lacking:
        raise SchemaError("chapters of the report", lacking)
    return chapters


def _to_plain(item: Any) -> Any:
    """Return data as JSON types; a dataclass or bytes as an object with the name of its type."""
    if is_dataclass(item) and not isinstance(item, type):
        values = {field.name: _to_plain(getattr(item, field.name)) for field in fields(item)}
        return {_KIND: type(item).__name__, **values}
    if isinstance(item, bytes):
        return {_KIND: "bytes", "base64": base64.b64encode(item).decode()}
    if isinstance(item, Mapping):
        return {str(key): _to_plain(value) for key, value in item.items()}
    if isinstance(item, list | tuple):
        return [_to_plain(value) for value in item]
    return to_json_types(item)


def _from_plain(item: Any) -> Any:
    """Return the data from which `_to_plain` made JSON types."""
    if isinstance(item, list):
        return [_from_plain(value) for value in item]
    if not isinstance(item, dict):
        return item
    if item.get(_KIND) == "bytes":
        return base64.b64decode(item["base64"])
    values = {key: _from_plain(value) for key, value in item.items() if key != _KIND}
    kind = _KINDS.get(item.get(_KIND, ""))
    if kind is None:
        return values
    return kind(**values)
