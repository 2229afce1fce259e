"""PDF document of a report: a tagged PDF/A-3b, typeset by typst, with the data attached.

Drawings and data are laid out in a folder for typst.  Equal input gives equal bytes: the fonts are
part of this package, system fonts are off, and the date is that of the results.
"""

from __future__ import annotations

import datetime
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from flightmech.errors import SchemaError
from flightmech.support.console import to_json_types
from pom.report.chapters import Chapters
from pom.report.models.tuning import NOTE
from pom.report.pdf.content import (
    front_content,
    submodel_content,
    table_of,
    tuning_content,
)
from pom.report.pdf.style import Drawing, save_drawing, svg_drawing
from pom.report.submodels.section import Picture
from pom.report.submodels.sections import chapter_title
from pom.result import PomResult

STANDARDS: Any = ["a-3b", "ua-1"]
UNDATED = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
"""Date in the metadata of a report without any date and without an input file.

PDF/A requires a date, and the clock is not read.
"""

# Messages of typst on characters that no font has; it writes marks and controls as \u{301}.
_GLYPHLESS = re.compile(r'the text `"(.+?)"` could not be displayed')
_ESCAPED = re.compile(r"\\u\{([0-9a-f]+)\}")
# Control characters and surrogates, as the JSON text has them.
_CONTROL = re.compile(r"\\u00[01][0-9a-f]|[\ud800-\udfff]")
_HERE = Path(__file__).parent
_FONTS = _HERE.parent / "static" / "fonts"
_MIME = {".json": "application/json", ".csv": "text/csv", ".nc": "application/x-netcdf"}


@dataclass(frozen=True)
class DocumentContent:
    """Content of ``report.pdf`` besides its cases.

    Attributes
    ----------
    title, revision : str
    provenance : mapping
        Provenance without paths, as `pom.write_report` prints it.
    paper : {"a4", "letter"}
    attached : mapping of str to bytes
        Contents of the attached files, by name.
    chapters : Chapters
    tunings : sequence of mapping
        Tunings of models, from `pom.report.models.tuning.tuning_context`.
    created : datetime
        Date in the metadata (`document_date`).
    """

    title: str
    revision: str
    provenance: Mapping[str, Any]
    paper: str
    attached: Mapping[str, bytes]
    chapters: Chapters
    tunings: Sequence[Mapping[str, Any]] = ()
    created: datetime.datetime = UNDATED


def document_date(provenance: Mapping[str, Any]) -> datetime.datetime:
    """Return the date in the metadata of a report.

    It is the date of the results.  Without one it is the day on which the newest input file was
    changed, so that the same files give the same report on any day.

    Parameters
    ----------
    provenance : mapping
        Provenance with the paths of the inputs.
    """
    stated = _parse_date(provenance.get("date", ""))
    if stated is not None:
        return stated
    days = []
    for place in provenance.get("places", {}).values():
        path = Path(place)
        if path.is_file():
            changed = datetime.datetime.fromtimestamp(path.stat().st_mtime, datetime.UTC)
            days.append(changed.replace(hour=0, minute=0, second=0, microsecond=0))
    return max(days, default=UNDATED)


def pdf_pages(
    folder: Path,
    results: Sequence[PomResult],
    names: Sequence[str],
    cases: Sequence[Mapping[str, Any]],
    content: DocumentContent,
) -> bytes:
    """Return the bytes of ``report.pdf``.

    Parameters
    ----------
    folder : Path
        Folder with the drawings of the cases.  The document is laid out there.
    results : sequence of PomResult
    names : sequence of str
        Keys of the results (`pom.report.case.page.case_keys`).
    cases : sequence of mapping
        Data of every case (`pom.report.pdf.content.case_on_paper`).
    content : DocumentContent
        Title, chapters and attached files.

    Raises
    ------
    SchemaError
        Typst is not installed, or it cannot typeset the document.  The error has its message.
    """
    chapters = content.chapters
    data = front_content(
        results,
        names,
        title=content.title,
        revision=content.revision,
        provenance=content.provenance,
        databases=chapters.roots,
    )
    data["attached"] = _attach_files(folder, content.attached)
    submodels = []
    for position, section in enumerate(chapters.submodels):
        pictures = _save_pictures(folder, f"s{position}", section.pictures)
        submodels.append(submodel_content(section) | {"pictures": pictures})
    data |= {
        "cases": cases,
        "submodels": submodels,
        "submodels_title": chapter_title(chapters.submodels),
        "tunings": [tuning_content(tuning) for tuning in content.tunings],
        "tuning_note": NOTE,
        "identification": None,
        "databases": None,
        "needed": table_of(chapters.needed),
        "ranking": table_of(chapters.ranking),
        "ranking_text": chapters.ranking_text,
        "paper": {"a4": "a4", "letter": "us-letter"}[content.paper],
    }
    # These two chapters are printed only if the user selected them for paper.
    if "identification" in chapters.on_paper and chapters.identification is not None:
        data["identification"] = _identification_content(folder, chapters.identification)
    if "database" in chapters.on_paper and chapters.compared is not None:
        data["databases"] = _databases_content(folder, chapters.compared)

    text = _CONTROL.sub("?", json.dumps(to_json_types(data), ensure_ascii=False))
    (folder / "data.json").write_text(text, encoding="utf-8", errors="replace")
    (folder / "report.typ").write_bytes((_HERE / "report.typ").read_bytes())
    return _typeset(folder, content.created)


def _typeset(folder: Path, date: datetime.datetime) -> bytes:
    """Typeset the folder with typst, and return the PDF."""
    try:
        import typst
    except ImportError as error:
        raise SchemaError(
            "report.pdf",
            ["typst is not installed; pip install it, or leave the PDF out (--no-pdf, paper=None)"],
        ) from error
    # First our fonts only.  If a script is missing there, the system fonts are added.  Characters
    # that are still missing become "?" before the last pass.
    for ours_only in (True, False, False):
        try:
            return typst.compile(
                str(folder / "report.typ"),
                root=str(folder),
                format="pdf",
                font_paths=[str(_FONTS)],
                ignore_system_fonts=ours_only,
                pdf_standards=STANDARDS,
                timestamp=date,
            )
        except typst.TypstError as error:
            problem, missing = error, _missing_characters(error.diagnostic)
            if not missing:
                break
            if not ours_only:
                _replace_characters(folder, missing)
    raise SchemaError("report.pdf", [f"typst: {problem.message}"]) from problem


def _missing_characters(diagnostic: str) -> set[str]:
    """Return the characters that typst found in no font."""
    reported = "".join(_GLYPHLESS.findall(diagnostic))
    characters = set(_ESCAPED.sub("", reported))
    for code in _ESCAPED.findall(reported):
        characters.add(chr(int(code, 16)))
    # Typst reports whole texts.  Every font has the printable ASCII characters.
    return {character for character in characters if not " " <= character <= "~"}


def _replace_characters(folder: Path, missing: set[str]) -> None:
    """Replace characters by question marks in the data and the drawings."""
    question_marks = dict.fromkeys(map(ord, missing), "?")
    for path in [folder / "data.json", *folder.glob("*.svg")]:
        text = path.read_text(encoding="utf-8")
        path.write_text(text.translate(question_marks), encoding="utf-8")


def _parse_date(text: str) -> datetime.datetime | None:
    """Return the date of the results; None if the text is not an ISO 8601 date."""
    try:
        date = datetime.datetime.fromisoformat(text)
    except ValueError:
        return None
    if date.tzinfo:
        return date
    return date.replace(tzinfo=datetime.UTC)


def _attach_files(folder: Path, attached: Mapping[str, bytes]) -> list[dict[str, str]]:
    """Write the attached files, and return their rows for the template."""
    rows = []
    for name, body in attached.items():
        (folder / name).write_bytes(body)
        rows.append(
            {
                "name": name,
                "mime": _MIME.get(Path(name).suffix, "application/octet-stream"),
                "sha256": sha256(body).hexdigest(),
            }
        )
    return rows


def _save_pictures(folder: Path, stem: str, pictures: Sequence[Picture]) -> list[dict[str, Any]]:
    """Write pictures as ``<stem>-<number>.svg``, and return their entries in the data."""
    entries = []
    for number, picture in enumerate(pictures):
        entries.append(_save_picture(folder, f"{stem}-{number}.svg", picture))
    return entries


def _save_picture(folder: Path, name: str, picture: Picture) -> dict[str, Any]:
    svg = svg_drawing(picture.height, picture.body)
    return save_drawing(folder, name, Drawing(svg, picture.height, picture.words))


def _identification_content(folder: Path, chapter: Mapping[str, Any]) -> dict[str, Any]:
    """Return the data of the chapter on identification, and write its figures."""
    fits = []
    for fit in chapter["fits"]:
        row = {key: value for key, value in fit.items() if key != "drawing"}
        row["picture"] = None
        if fit["drawing"]:
            row["picture"] = _save_picture(folder, f"i{fit['index']}.svg", fit["drawing"])
        fits.append(row)
    sample_map = None
    if chapter["map"]:
        sample_map = _save_picture(folder, "i-map.svg", chapter["map"])
    return {"fits": fits, "map": sample_map}


def _databases_content(folder: Path, chapter: Mapping[str, Any]) -> dict[str, Any]:
    """Return the data of the comparison of databases, and write its figures."""
    # The template reads lists of texts; figures are files.
    terms = []
    for number, term in enumerate(chapter["terms"]):
        row = {key: term.get(key) for key in ("term", "words", "state", "factors", "scalars")}
        row["pictures"] = _save_pictures(folder, f"d{number}", term["figures"])
        terms.append(row)
    changes = chapter["changes"]
    if changes is not None:
        rows = []
        for row in changes["rows"]:
            columns = ("term", "words", "change", "errors", "where", "flown")
            rows.append([row[key] for key in columns])
        changes = {**changes, "rows": rows}
    same = []
    for item in chapter["same"]:
        leaf = item["leaf"]
        facts = [leaf["shape"], leaf["regressors"], leaf["source"]]
        same.append([item["term"], item["words"], *facts])
    return {"terms": terms, "changes": changes, "same": same, "roots": chapter["databases"]}
