"""Files of a drafted project: each is written, merged with the edits of its author, or left alone.

A file of the author is never overwritten without a copy.  After an error all files are as before.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType

from aeromatch.drafting.merging import (
    MergedText,
    is_other_flight,
    merge_manoeuvres,
    merge_toml,
)
from aeromatch.drafting.name_map.name_text import LEFT_OUT, without_left_out
from aeromatch.drafting.previous import DRAFT_FOLDER, read_draft
from flightmech.support.atomic_write import write_text, written_atomically
from flightmech.support.toml_files import read_toml

# Files that get the news of a draft also if their author has written them.
_MERGED = ("names.toml", "manoeuvres.csv")


@dataclass
class ProjectFiles:
    """Writer of the files of a project; use it in a ``with`` statement.

    Attributes
    ----------
    folder : Path
    is_anew : bool
        Whether drafts replace the edits of the author, whose files are copied before.
    written : list of Path
        Files of the project, in the order of writing.
    remarks : list of str
        Copies, and values of the author that differ from the draft.
    """

    folder: Path
    is_anew: bool = False
    written: list[Path] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    _before: dict[Path, bytes | None] = field(default_factory=dict)
    _new_folders: list[Path] = field(default_factory=list)

    def __enter__(self) -> ProjectFiles:
        # From the innermost folder outward, so that each is empty when it is removed.
        chain = (
            self.folder / "cases",
            self.folder / DRAFT_FOLDER,
            self.folder,
            *self.folder.parents,
        )
        self._new_folders = [item for item in chain if not item.exists()]
        (self.folder / "cases").mkdir(parents=True, exist_ok=True)
        (self.folder / DRAFT_FOLDER).mkdir(exist_ok=True)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is not None:
            self._restore()

    def drafted(self, name: str) -> Path:
        """Return the place of a file as it was drafted last; the file need not exist.

        The folder is as deep as that of the cases, so that relative paths are the same.
        """
        return self.folder / DRAFT_FOLDER / Path(name).name

    def write(self, name: str, new: str) -> None:
        """Write a file of the project.

        Parameters
        ----------
        name : str
            Path relative to the folder.
        new : str
            Text of the new draft.
        """
        file, draft = self.folder / name, self.drafted(name)
        before = read_draft(draft)
        if file.exists() and not before and name not in _MERGED and not self.is_anew:
            self.remarks.append(f"{name}: not drafted by init, and left alone")
            self.written.append(file)
            return
        merged = MergedText(new)
        if file.exists():
            own = file.read_text(encoding="utf-8")
            if own not in (before, new):
                if file.suffix == ".toml" and not self.is_anew:
                    # Its reader names the line of a fault.
                    read_toml(file)
                merged = MergedText(new) if self.is_anew else self._merge(name, before, own, new)
                if merged.text != own:
                    self._copy(file)
        for key in merged.kept:
            self.remarks.append(f"{name}: {key} stays as you wrote it; a new draft differs")
        if not file.exists() or merged.text != file.read_text(encoding="utf-8"):
            self.replace(file, merged.text)
        self.replace(draft, new)
        self.written.append(file)

    def _merge(self, name: str, before: str, own: str, new: str) -> MergedText:
        """Return the author's file with the news of a draft."""
        if name.endswith(".csv"):
            return merge_manoeuvres(before, own, new)
        if name.startswith("cases/") and is_other_flight(before, new):
            return MergedText(own, ("the whole file: another record or window",))
        # The comment at the end lists columns of the recordings, and is not a matter of the author.
        # What the author has written below it, such as tables of more channels, stays.
        _, mark, columns = new.partition(LEFT_OUT)
        merged = merge_toml(without_left_out(before), without_left_out(own), without_left_out(new))
        end = f"\n{mark}{columns}" if mark else ""
        return MergedText(merged.text.rstrip("\n") + "\n" + end, merged.kept)

    def replace(self, file: Path, text: str) -> None:
        """Write a file, which an error later restores."""
        self._remember(file)
        write_text(file, text)

    def is_removed(self, name: str) -> bool:
        """Return whether the author has removed a file of the last draft."""
        is_absent = not (self.folder / name).exists() and self.drafted(name).exists()
        return is_absent and not self.is_anew

    def remove_unedited(self, name: str) -> None:
        """Remove a drafted file that a new draft does not have, unless the author has edited it."""
        file, draft = self.folder / name, self.drafted(name)
        if file.exists() and draft.exists() and file.read_bytes() == draft.read_bytes():
            for item in (file, draft):
                self._remember(item)
                item.unlink()
            self.remarks.append(f"{name}: removed, the new draft does not have it")

    def _copy(self, file: Path) -> None:
        number = 1
        while (copy := file.with_name(f"{file.name}.{number}.bak")).exists():
            number += 1
        self.replace(copy, file.read_text(encoding="utf-8"))
        self.remarks.append(f"{file.name}: your file before this draft is {copy.name}")

    def _remember(self, file: Path) -> None:
        self._before.setdefault(file, file.read_bytes() if file.exists() else None)

    def _restore(self) -> None:
        """Restore all files and remove new folders.

        On a defective disk a file may stay that is complete and new.  No older file is emptied,
        and the first error is raised.
        """
        for file, content in self._before.items():
            with suppress(OSError):
                if content is None:
                    file.unlink(missing_ok=True)
                else:
                    with written_atomically(file) as part:
                        part.write_bytes(content)
        for folder in self._new_folders:
            with suppress(OSError):
                folder.rmdir()
