"""The document: drawings and data laid out in a folder, typeset by typst to a tagged PDF/A-3b with
the data attached.

Fonts come with this package and system fonts are off; the date comes from the results: equal input
gives equal bytes.
"""

from __future__ import annotations

import datetime
import json
import re
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from flightmech.errors import SchemaError
from flightmech.support.console import to_json_types
from pom.report.chapters import Chapters
from pom.report.models.diagnosis import NOTE
from pom.report.pdf import content
from pom.report.pdf.content import save_drawing
from pom.report.pdf.drawings import Drawing, svg_drawing
from pom.report.submodels.section import Picture, Section
from pom.result import PomResult

STANDARDS: Any = ["a-3b", "ua-1"]
UNDATED = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
"""PDF/A demands a date and no clock is read: a report without a date carries this one in its metadata, and states so on its cover."""

_GLYPHLESS = re.compile(r'the text `"(.+?)"` could not be displayed')
_ESCAPED = re.compile(r"\\u\{([0-9a-f]+)\}")
_CONTROL = re.compile(r"\\u00[01][0-9a-f]|[\ud800-\udfff]")  # in JSON
_HERE = Path(__file__).parent
_FONTS = _HERE.parent / "static" / "fonts"
_MIME = {".json": "application/json", ".csv": "text/csv", ".nc": "application/x-netcdf"}


def pdf_pages(
    folder: Path,
    results: Sequence[PomResult],
    names: Sequence[str],
    cases: Sequence[Mapping[str, Any]],
    title: str,
    revision: str,
    provenance: Mapping[str, Any],
    paper: str,
    attached: Mapping[str, bytes],
    chapters: Chapters,
    tunings: Sequence[Mapping[str, Any]] = (),
) -> bytes:
    """Return ``report.pdf``; arguments that are not listed are those of `pom.write_report`.

    Parameters
    ----------
    folder : Path
        Holds the drawings of the cases; the document is laid out there.
    names : sequence of str
        `case.case_keys` of the results.
    cases : sequence of mapping
        `case_pages.case_on_paper` of every result.
    attached : mapping of str to bytes
        Files by name.
    chapters : Chapters
    tunings : sequence of mapping
        Of `tuning.context`.

    Raises
    ------
    SchemaError
        Typst cannot set the document, with its words.
    """
    front = content.front_content(results, names, title, revision, provenance, chapters.roots)
    front["attached"] = _attach(folder, attached)
    chapter = [
        content.submodel_content(one) | {"pictures": _pictures(folder, i, one)}
        for i, one in enumerate(chapters.submodels)
    ]
    data = {
        **front,
        "cases": cases,
        "submodels": chapter,
        "tunings": [content.tuning_content(one) for one in tunings],
        "tuning_note": NOTE,
        "identification": _identification(
            folder, chapters.identification if "identification" in chapters.on_paper else None
        ),
        "databases": _databases(
            folder, chapters.compared if "database" in chapters.on_paper else None
        ),
        "needed": content.table_of(chapters.needed),
        "paper": {"a4": "a4", "letter": "us-letter"}[paper],
    }
    text = _CONTROL.sub("?", json.dumps(to_json_types(data), ensure_ascii=False))
    (folder / "data.json").write_text(text, encoding="utf-8", errors="replace")
    (folder / "report.typ").write_bytes((_HERE / "report.typ").read_bytes())
    return _set(folder, _date(provenance.get("date", "")))


def _set(folder: Path, date: datetime.datetime) -> bytes:
    """Typeset the folder; texts in scripts that our fonts lack take those of the system, and what
    no font has becomes ``?``.
    """
    try:
        import typst
    except ImportError as error:
        raise SchemaError(
            "report.pdf",
            ["typst is not installed; pip install it, or leave the PDF out (--no-pdf, paper=None)"],
        ) from error
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
            problem, missing = error, _missing(error.diagnostic)
            if not missing:
                break
            if not ours_only:
                _replace(folder, missing)
    raise SchemaError("report.pdf", [f"typst: {problem.message}"]) from problem


def _missing(words: str) -> set[str]:
    """Return the characters that typst found in no font; it writes marks and controls as ``\\u{301}``."""
    found = "".join(_GLYPHLESS.findall(words))
    escaped = {chr(int(code, 16)) for code in _ESCAPED.findall(found)}
    return {
        character
        for character in escaped | set(_ESCAPED.sub("", found))
        if not " " <= character <= "~"
    }


def _replace(folder: Path, missing: set[str]) -> None:
    for path in [folder / "data.json", *folder.glob("*.svg")]:
        text = path.read_text(encoding="utf-8")
        path.write_text(text.translate(dict.fromkeys(map(ord, missing), "?")), encoding="utf-8")


def _date(text: str) -> datetime.datetime:
    """Return the date of the results, or `UNDATED` where none is given or it is not ISO 8601."""
    try:
        date = datetime.datetime.fromisoformat(text)
    except ValueError:
        return UNDATED
    return date if date.tzinfo else date.replace(tzinfo=datetime.UTC)


def _attach(folder: Path, attached: Mapping[str, bytes]) -> list[dict[str, str]]:

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


def _pictures(folder: Path, position: int, section: Section) -> list[dict[str, Any]]:
    """Return the figures of a submodel, drawn for paper."""
    return [
        _on_paper(folder, f"s{position}-{i}.svg", one) for i, one in enumerate(section.pictures)
    ]


def _on_paper(folder: Path, name: str, picture: Picture) -> dict[str, Any]:
    return save_drawing(
        folder,
        name,
        Drawing(svg_drawing(picture.height, picture.body), picture.height, picture.words),
    )


def _identification(folder: Path, chapter: Mapping[str, Any] | None) -> dict[str, Any] | None:
    if chapter is None:
        return None
    fits = []
    for fit in chapter["fits"]:
        shown = {key: value for key, value in fit.items() if key != "drawing"}
        fits.append(
            shown
            | {
                "picture": _on_paper(folder, f"i{fit['index']}.svg", fit["drawing"])
                if fit["drawing"]
                else None
            }
        )
    return {
        "fits": fits,
        "map": _on_paper(folder, "i-map.svg", chapter["map"]) if chapter["map"] else None,
    }


def _databases(folder: Path, chapter: Mapping[str, Any] | None) -> dict[str, Any] | None:
    if chapter is None:
        return None
    terms = []
    for i, term in enumerate(chapter["terms"]):
        pictures = [
            _on_paper(folder, f"d{i}-{k}.svg", one) for k, one in enumerate(term["figures"])
        ]
        terms.append(
            {key: term.get(key) for key in ("term", "words", "state", "factors", "scalars")}
            | {"pictures": pictures}
        )
    changes = chapter["changes"]
    if changes is not None:
        columns = ("term", "words", "change", "errors", "where", "flown")
        changes = {**changes, "rows": [[row[key] for key in columns] for row in changes["rows"]]}
    same = [
        [
            item["term"],
            item["words"],
            item["leaf"]["shape"],
            item["leaf"]["regressors"],
            item["leaf"]["source"],
        ]
        for item in chapter["same"]
    ]
    return {"terms": terms, "changes": changes, "same": same, "roots": chapter["databases"]}
