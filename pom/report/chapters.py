"""The chapters of a report in addition to its cases, drawn: databases, identification, submodels;
kept with the results.

They are made from databases of 12 MB and fits of 50 MB and more, which a report does not hold.
What page and paper show of them is kept as it is drawn, in ``results.nc``: a report is written
again with its chapters, and without those files.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import pandas as pd
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.support.console import to_json_types
from flighttest.regression.equation_error.fit import Fit
from pom.report.case.page import run_line_classes
from pom.report.models import database_comparison, identification
from pom.report.submodels.section import Picture, Section, SectionTable
from pom.report.submodels.sections import make_sections, needed_submodels

CHAPTERS = ("identification", "database")
"""Chapters of the PDF that are printed when wanted."""

_ATTRIBUTES = ("title", "aircraft", "source", "absent", "notices")
_KINDS = {kind.__name__: kind for kind in (Picture, Section, SectionTable)}
_KIND = "of"


@dataclass(frozen=True)
class Chapters:
    """What a report shows in addition to its cases.

    Attributes
    ----------
    databases : dict of str to dict
        Title, aircraft, source and absent terms of the databases, by name.
    compared : dict or None
        Of `database_comparison.compare_for_report`.
    identification : dict or None
        Of `identification.identification_chapter`.
    submodels : tuple of Section
    needed : Grid or None
        What the corrected model takes from the final one.
    on_paper : tuple of str
        Chapters of the PDF among `CHAPTERS`.
    """

    databases: dict[str, dict[str, str]]
    compared: dict[str, Any] | None = None
    identification: dict[str, Any] | None = None
    submodels: tuple[Section, ...] = ()
    needed: SectionTable | None = None
    on_paper: tuple[str, ...] = ()

    @property
    def roots(self) -> dict[str, xr.DataTree]:
        """The databases without their terms."""
        return {
            name: xr.DataTree(xr.Dataset(attrs=dict(attrs)))
            for name, attrs in self.databases.items()
        }

    def kept(self) -> bytes:
        """Return the chapters as they are kept in ``results.nc``; empty where there is none."""
        if not (self.databases or self.identification or self.submodels):
            return b""
        return json.dumps(
            _plain(self), ensure_ascii=False, sort_keys=True, separators=(",", ":")
        ).encode()


def draw_chapters(
    databases: Mapping[str, xr.DataTree],
    support: Mapping[str, pd.DataFrame],
    fits: Sequence[Fit],
    level_lines: Mapping[str, xr.Dataset],
    submodels: Sequence[Section],
    diagnoses: Mapping[str, pd.DataFrame],
    on_paper: Sequence[str],
) -> Chapters:
    """Return the chapters of what `pom.write_report` was given; the figures of fits are drawn for
    paper where it is wanted.
    """
    attributes = {
        name: {key: str(db.attrs[key]) for key in _ATTRIBUTES if key in db.attrs}
        for name, db in databases.items()
    }
    return Chapters(
        attributes,
        database_comparison.compare_for_report(databases, support, run_line_classes(databases))
        if databases
        else None,
        identification.identification_chapter(fits, level_lines, "identification" in on_paper)
        if fits
        else None,
        tuple(submodels),
        needed_submodels(diagnoses, databases) if submodels else None,
        tuple(on_paper),
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
) -> Chapters:
    """Return what `pom.write_report` takes as `kept` in the place of these arguments of it: the
    same report, drawn once.
    """
    found = make_sections(submodels, free_motion, driven_motion)
    return draw_chapters(databases, {}, fits, level_lines, found, diagnoses, chapters)


def restore_chapters(kept: bytes) -> Chapters:
    """Return the chapters that `Chapters.kept` gave."""
    found = _restored(json.loads(kept)) if kept else {}
    return Chapters(
        found.get("databases", {}),
        found.get("compared"),
        found.get("identification"),
        tuple(found.get("submodels", ())),
        found.get("needed"),
        tuple(found.get("on_paper", ())),
    )


def with_kept(now: Chapters, before: Chapters, on_paper: Sequence[str] | None = None) -> Chapters:
    """Return the chapters of an earlier report, with those made now in their place.

    Parameters
    ----------
    now, before : Chapters
    on_paper : sequence of str, optional
        Chapters of the PDF; those of the earlier report unless given.

    Raises
    ------
    SchemaError
        A chapter for paper that is among neither.
    """
    wanted = before.on_paper if on_paper is None else tuple(on_paper)
    found = replace(now, on_paper=wanted)
    if not now.databases:
        found = replace(found, databases=before.databases, compared=before.compared)
    if not now.identification:
        found = replace(found, identification=before.identification)
    if not now.submodels:
        found = replace(found, submodels=before.submodels, needed=before.needed)
    fits = found.identification["fits"] if found.identification else []
    lacking = []
    if "identification" in wanted and not any(fit.get("drawing") for fit in fits):
        lacking.append(
            "identification: the results hold no figures of it; match again with it among "
            "the chapters of the project"
        )
    if "database" in wanted and not found.compared:
        lacking.append(
            "database: the results compare no databases; give them as --database NAME=FILE.nc"
        )
    if lacking:
        raise SchemaError("chapters of the report", lacking)
    return found


def _plain(item: Any) -> Any:
    if is_dataclass(item) and not isinstance(item, type):
        return {
            _KIND: type(item).__name__,
            **{one.name: _plain(getattr(item, one.name)) for one in fields(item)},
        }
    if isinstance(item, bytes):
        return {_KIND: "bytes", "base64": base64.b64encode(item).decode()}
    if isinstance(item, Mapping):
        return {str(key): _plain(value) for key, value in item.items()}
    if isinstance(item, list | tuple):
        return [_plain(value) for value in item]
    return to_json_types(item)


def _restored(item: Any) -> Any:
    if isinstance(item, list):
        return [_restored(value) for value in item]
    if not isinstance(item, dict):
        return item
    if item.get(_KIND) == "bytes":
        return base64.b64decode(item["base64"])
    values = {key: _restored(value) for key, value in item.items() if key != _KIND}
    kind = _KINDS.get(item.get(_KIND, ""))
    return values if kind is None else kind(**values)
