"""The last draft of a project, which a new draft needs to see what the author has changed."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from aeromatch.drafting.aircraft import StatedFacts
from flightmech.errors import ParseError

DRAFT_FOLDER = ".draft"
"""Folder in a project with its files as they were drafted, and with the answers of the author."""
ANSWERS = "answers.json"
"""File of the answers in this folder."""


@dataclass(frozen=True)
class DraftAnswers:
    """What the author has stated for a draft, so that it is requested once.

    Attributes
    ----------
    facts : StatedFacts
    datcom, records : tuple of Path
        Listings, decks and recordings, or folders of them; both are empty for the folder of the
        project.
    prove : tuple of str
    own_map : str
        Name map outside of the project, or the name of a shipped one; empty without it.
    """

    facts: StatedFacts = field(default_factory=StatedFacts)
    datcom: tuple[Path, ...] = ()
    records: tuple[Path, ...] = ()
    prove: tuple[str, ...] = ()
    own_map: str = ""

    def extended(self, newer: DraftAnswers) -> DraftAnswers:
        """Return these answers with newer ones in their place."""
        old, new = self.facts, newer.facts
        facts = StatedFacts(
            new.name or old.name,
            {**old.values, **new.values},
            cg=new.cg or old.cg,
            imu=new.imu or old.imu,
        )
        return replace(
            newer,
            facts=facts,
            datcom=newer.datcom or self.datcom,
            records=newer.records or self.records,
            prove=newer.prove or self.prove,
            own_map=newer.own_map or self.own_map,
        )

    def to_json(self, folder: Path) -> str:
        """Return the answers as text; paths are relative to the folder where they can be."""
        content = {
            "name": self.facts.name,
            "values": self.facts.values,
            "cg": self.facts.cg,
            "imu": self.facts.imu,
            "prove": self.prove,
            "datcom": [_relative(path, folder) for path in self.datcom],
            "records": [_relative(path, folder) for path in self.records],
            "names": self.own_map,
        }
        return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def read_answers(folder: Path) -> DraftAnswers:
    """Return the answers of the last draft in a folder; none without a draft.

    Raises
    ------
    ParseError
        The file of the answers is damaged.
    """
    file = folder / DRAFT_FOLDER / ANSWERS
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        return _parse_answers(content, folder)
    except FileNotFoundError:
        return DraftAnswers()
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ParseError(
            str(file), 0, f"damaged answers of the last draft ({error})", "the file removed"
        ) from error


def read_draft(file: Path) -> str:
    """Return the text of a file as it was drafted last; empty without a draft.

    Raises
    ------
    ParseError
        The text is damaged.
    """
    if not file.exists():
        return ""
    try:
        text = file.read_text(encoding="utf-8")
        if file.suffix == ".toml":
            tomllib.loads(text)
        is_whole = file.suffix != ".csv" or "record" in text.partition("\n")[0].split(",")
    except ValueError:
        is_whole = False
    if not is_whole:
        raise ParseError(
            str(file),
            0,
            "a damaged file of the last draft",
            "the file removed; then all of your file of this name counts as yours and stays",
        )
    return text


def _parse_answers(content: Mapping[str, Any], folder: Path) -> DraftAnswers:
    facts = StatedFacts(
        str(content["name"]),
        {str(key): str(value) for key, value in content["values"].items()},
        cg=_three_texts(content["cg"]),
        imu=_three_texts(content["imu"]),
    )
    return DraftAnswers(
        facts,
        datcom=tuple(folder / path for path in content["datcom"]),
        records=tuple(folder / path for path in content["records"]),
        prove=tuple(map(str, content["prove"])),
        own_map=str(content["names"]),
    )


def _three_texts(texts: Sequence[str] | None) -> tuple[str, str, str] | None:
    if texts is None:
        return None
    x, y, z = map(str, texts)
    return x, y, z


def _relative(path: Path, folder: Path) -> str:
    try:
        return path.resolve().relative_to(folder.resolve()).as_posix()
    except ValueError:
        return str(path.resolve())
