"""Reasons for which stages run: changes since the last job that wrote the same folder."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from flightmech.support.atomic_write import written_atomically


class StageTrace:
    """Hashes of the inputs of all stages in the last job of a folder.

    The file gets a line when a stage begins, so a killed job leaves the lines of the stages that it
    began. The last line of a stage is the valid one.

    Parameters
    ----------
    file : Path
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._before: dict[str, dict[str, str]] = {}
        with suppress(OSError):
            for line in file.read_bytes().splitlines():
                # a line can be damaged, and the last line of a killed job can be incomplete
                with suppress(ValueError, TypeError):
                    name, inputs = json.loads(line)
                    self._before[name] = dict(inputs)
        self._now: dict[str, dict[str, str]] = {}

    @classmethod
    def of(cls, store: Path, output: Path) -> StageTrace:
        """Return the trace of an output folder. Its file is in the folder of the store."""
        name = hashlib.sha256(str(output.resolve()).encode()).hexdigest()[:32]
        return cls(store / "traces" / f"{name}.jsonl")

    def reason(self, name: str, inputs: Mapping[str, str]) -> str:
        """Return the reason for which a stage must run, as a text."""
        before = self._before.get(name)
        if before is None:
            return "not computed for this folder before"
        changed = [key for key in inputs if inputs[key] != before.get(key)]
        removed = [key for key in before if key not in inputs]
        texts = []
        if changed:
            texts.append(f"changed: {', '.join(changed)}")
        if removed:
            texts.append(f"left out: {', '.join(removed)}")
        return "; ".join(texts) or "nothing changed, but no intact result is kept"

    def note(self, name: str, inputs: Mapping[str, str]) -> None:
        """Record the inputs of a stage."""
        self._now[name] = dict(inputs)
        # the line of the last job is still valid
        if self._before.get(name) == self._now[name]:
            return
        with suppress(OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            with self._file.open("a", encoding="utf-8") as file:
                file.write(json.dumps([name, self._now[name]]) + "\n")

    def close(self) -> None:
        """Replace the file by the lines of this job."""
        lines = [json.dumps(item) + "\n" for item in self._now.items()]
        with suppress(OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            with written_atomically(self._file, durable=False) as part:
                part.write_text("".join(lines), encoding="utf-8")
