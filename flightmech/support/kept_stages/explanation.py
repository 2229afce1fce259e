"""Why a stage runs: its inputs set against those of the job that last wrote the same folder."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from flightmech.support.atomic_write import written_atomically


class StageTrace:
    """The inputs of every stage of the last job of a folder, by hash, one line each as the stages
    are reached.

    A job that is killed leaves the lines of what it reached; of several lines of one stage the last
    counts.

    Parameters
    ----------
    file : Path
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._before: dict[str, dict[str, str]] = {}
        with suppress(OSError):
            for line in file.read_text(encoding="utf-8").splitlines():
                with suppress(
                    ValueError, TypeError
                ):  # a line that was being written when the job was killed
                    name, inputs = json.loads(line)
                    self._before[name] = dict(inputs)
        self._now: dict[str, dict[str, str]] = {}

    @classmethod
    def of(cls, store: Path, output: Path) -> StageTrace:
        """Return the trace of an output folder, which lies in the folder of the store."""
        return cls(
            store
            / "traces"
            / f"{hashlib.sha256(str(output.resolve()).encode()).hexdigest()[:32]}.jsonl"
        )

    def reason(self, name: str, inputs: Mapping[str, str]) -> str:
        """Return why a stage has to run although a store is there, in words."""
        before = self._before.get(name)
        if before is None:
            return "not computed for this folder before"
        changed = [key for key in inputs if inputs[key] != before.get(key)]
        gone = [key for key in before if key not in inputs]
        if changed or gone:
            return "; ".join(
                [
                    *([f"changed: {', '.join(changed)}"] if changed else []),
                    *([f"left out: {', '.join(gone)}"] if gone else []),
                ]
            )
        return "nothing changed, but no intact result is kept"

    def note(self, name: str, inputs: Mapping[str, str]) -> None:
        """Keep the inputs of a stage."""
        self._now[name] = dict(inputs)
        if self._before.get(name) == self._now[name]:
            return
        with suppress(OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            with self._file.open("a", encoding="utf-8") as file:
                file.write(json.dumps([name, self._now[name]]) + "\n")

    def close(self) -> None:
        """Leave the lines of this job only."""

        with suppress(OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            with written_atomically(self._file, durable=False) as part:
                part.write_text(
                    "".join(json.dumps(item) + "\n" for item in self._now.items()), encoding="utf-8"
                )
