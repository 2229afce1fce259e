"""Checks of flight records kept next to the flights of a batch, so that a batch that goes on does not check them again."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from flightmech.support.atomic_write import write_text

from ..cases.case import PomCase
from ..replaying.state_cache import KeptStates
from .record_check import RecordCheck, RecordError


@dataclass(frozen=True)
class KeptChecks:
    """Checks by record, name map, aircraft and program; one file each.

    Attributes
    ----------
    folder : Path or None
        Made when it is missing; None keeps nothing.
    """

    folder: Path | None

    def read(self, case: PomCase) -> RecordCheck | None:
        """Return the check of the record of a case; None if it is not kept, or its file is damaged."""
        file = self._file(case)
        if file is None or not file.is_file():
            return None
        try:
            item: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
            errors = [RecordError(**error) for error in item["errors"]]
            return RecordCheck(item["record"], item["verdict"], tuple(errors))
        except (ValueError, KeyError, TypeError):
            return None

    def write(self, case: PomCase, check: RecordCheck) -> None:
        """Keep the check of the record of a case."""
        file = self._file(case)
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            write_text(file, json.dumps(asdict(check), ensure_ascii=False))

    def _file(self, case: PomCase) -> Path | None:
        if self.folder is None:
            return None
        return self.folder / "checks" / f"{KeptStates(self.folder, None).identity(case)}.json"
