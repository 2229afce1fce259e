"""Files of a data package: structure, manifest and hashes. Nothing in them is read or run."""

from __future__ import annotations

import json
import os
import re
import stat
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from aeromatch.delivery.package_opening import MOST_FILES
from aeromatch.delivery.places import (
    CONTENT,
    FORMATS,
    MANIFEST,
    README,
    RECORDINGS,
    ROADMAP,
    SIGNATURE,
    STATES,
)
from flightmech.errors import ParseError
from flightmech.support.foreign_code.portable_names import is_portable_name
from flightmech.support.foreign_code.process import printable
from flightmech.support.input_files import file_sha256, json_content

_LARGEST_MANIFEST = 64_000_000  # byte
# Longest name in a manifest, and what is printed of one that no package has. [characters]
_LONGEST_NAME, _SHOWN = 1000, 100
_DIGEST = re.compile(r"[0-9a-f]{64}")
# Every package has these files, so that a check is not avoided by leaving its file out.
_NEEDED = (
    "aircraft/final.toml",
    "database/final.nc",
    "models/final.fmu",
    "report/manifest.json",
    STATES,
    README,
    ROADMAP,
    RECORDINGS,
)


@dataclass(frozen=True)
class PackageCheck:
    """Result of one check.

    Attributes
    ----------
    kind : str
        ``structure``, ``signature``, ``hash``, ``report``, ``states`` or ``flown``.
    name : str
    good : bool
    detail : str
        Result in words, with numbers.
    """

    kind: str
    name: str
    good: bool
    detail: str = ""


def read_package_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of a package.

    Raises
    ------
    ParseError
        The file is not a manifest, or has a key twice.
    """
    file = folder / MANIFEST
    if file.stat().st_size > _LARGEST_MANIFEST:
        raise ParseError(str(file), 0, f"{file.stat().st_size} bytes", "a manifest")
    try:
        text = file.read_text(encoding="utf-8")
    except ValueError:
        raise ParseError(str(file), 0, "bytes that are not UTF-8", "a manifest") from None
    content = json_content(text, str(file), "a JSON object")
    if not isinstance(content, dict) or not isinstance(content.get("files"), dict):
        found = printable(str(content)[:40])
        raise ParseError(str(file), 0, found, "a manifest of a data package")
    if not isinstance(content.get("refused", {}), dict):
        raise ParseError(str(file), 0, "'refused' that is not a table", "reasons by file")
    # Of a key that stands twice, one program reads the first value and another one the last.
    repeated = _repeated_key(text)
    if repeated is not None:
        raise ParseError(str(file), 0, f"the key {repeated!r} twice", "each key once")
    return content


def _repeated_key(text: str) -> str | None:
    """Return a key that stands twice in an object of a JSON text, or None."""
    repeated: list[str] = []

    def note_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        names = [name for name, _ in pairs]
        repeated.extend(name for name in names if names.count(name) > 1)
        return dict(pairs)

    json.loads(text, object_pairs_hook=note_keys)
    return repeated[0] if repeated else None


def check_structure(folder: Path) -> list[PackageCheck]:
    """Check that a package has regular files with plain names, and all that a package needs.

    A link or a device of a folder would lead the verification to other files.
    """
    manifest = read_package_manifest(folder)
    faults: dict[str, str] = {}
    present: dict[str, bool] = {}
    for parent, folders, names in os.walk(folder):
        for name in [*folders, *names]:
            path = Path(parent) / name
            relative = path.relative_to(folder).as_posix()
            # lstat does not follow a link.
            mode = path.lstat().st_mode
            present[relative] = stat.S_ISDIR(mode)
            if not relative.isprintable():
                faults[repr(relative)] = "a name with control characters"
            elif not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
                faults[relative] = "a link or a device; a package has files and folders only"
            elif not is_portable_name(name):
                faults[relative] = "a name that Windows does not allow, or takes for a device"
        if len(present) > MOST_FILES:
            faults["files"] = f"more than {MOST_FILES}"
            break
    faults |= _manifest_faults(manifest)
    faults |= _find_alike(dict.fromkeys([*present, *manifest["files"]]))
    for name in _NEEDED:
        if present.get(name, True):
            faults[name] = "missing; every package has it"
    # A format is there, or the manifest states why it is not.
    for name in FORMATS:
        reason = manifest.get("refused", {}).get(name)
        if name not in present and not reason:
            faults[name] = f"missing, and {MANIFEST} states no reason"
        elif reason and not _is_empty(folder / name):
            faults[name] = f"there, but {MANIFEST} states why it is not"
    checks = []
    for name, fault in faults.items():
        checks.append(PackageCheck("structure", name, good=False, detail=fault))
    if not checks:
        checks.append(PackageCheck("structure", "files", good=True, detail=f"{len(present)}"))
    return checks


def _is_empty(path: Path) -> bool:
    """Return whether a path is nothing, or a folder without files."""
    if path.is_dir() and not path.is_symlink():
        return not any(path.iterdir())
    return not os.path.lexists(path)


def _manifest_faults(manifest: Mapping[str, Any]) -> dict[str, str]:
    """Return what is wrong with the keys of a manifest, by name."""
    faults: dict[str, str] = {}
    for key in manifest.keys() - _KEYS.keys():
        faults[f"{MANIFEST}: {printable(key)[:40]}"] = "a key that no package has"
    for key, is_right in _KEYS.items():
        if key not in manifest or not is_right(manifest[key]):
            faults[f"{MANIFEST}: {key}"] = "missing, or not as a package states it"
    for name, digest in manifest["files"].items():
        if not _is_plain(name):
            # a name of megabytes would push the verdict off the screen
            faults[repr(name[:_SHOWN])] = f"a name in {MANIFEST} that leads out of the package"
        elif len(name) > _LONGEST_NAME:
            fault = f"a name of {len(name)} characters in {MANIFEST}; at most {_LONGEST_NAME}"
            faults[name[:_SHOWN]] = fault
        elif not (isinstance(digest, str) and _DIGEST.fullmatch(digest)):
            faults[name] = f"no SHA-256 in {MANIFEST}"
    return faults


def _is_text(value: Any) -> bool:
    # half of a surrogate pair can be in JSON, and in no file
    return isinstance(value, str) and not any("\ud800" <= char <= "\udfff" for char in value)


def _are_texts(value: Any) -> bool:
    return isinstance(value, list) and value != [] and all(map(_is_text, value))


def _are_reasons(value: Any) -> bool:
    """Return whether a value is a table of reasons for files that a package may lack."""
    if not isinstance(value, dict) or not value.keys() <= {*FORMATS}:
        return False
    return all(_is_text(reason) and reason for reason in value.values())


# Keys of a manifest, each with the function that accepts its value.
_KEYS: dict[str, Callable[[Any], bool]] = {
    "content": lambda value: value == CONTENT,
    "title": _is_text,
    "revision": _is_text,
    "version": _is_text,
    "platforms": _are_texts,
    "refused": _are_reasons,
    "files": lambda value: isinstance(value, dict),
}


def _find_alike(names: Iterable[str]) -> dict[str, str]:
    """Return the names that other systems take for another name of the list.

    On Windows and macOS one of the two files would replace the other.
    """
    faults: dict[str, str] = {}
    seen: dict[tuple[str, ...], str] = {}
    for name in names:
        parts = [_portable_part(part) for part in name.split("/")]
        first = seen.setdefault(tuple(parts), name)
        if first != name:
            faults[printable(name)] = f"other systems take it for {printable(first)}"
    return faults


def _portable_part(part: str) -> str:
    """Return the part of a path without case, form of its accents, and the ends Windows ignores."""
    folded = unicodedata.normalize("NFKC", part).casefold()
    return folded.split(":")[0].rstrip(" .")


def _is_plain(name: Any) -> bool:
    """Return whether a name of the manifest is a printable relative path inside of the package."""
    if not isinstance(name, str) or not name or not name.isprintable() or "\\" in name:
        return False
    path = PurePosixPath(name)
    return not path.is_absolute() and ".." not in path.parts and str(path) == name


def check_hashes(folder: Path) -> list[PackageCheck]:
    """Return a check of every file of the manifest, and of every file that is not in it."""
    return list(_compare_hashes(folder))


def _compare_hashes(folder: Path) -> Iterator[PackageCheck]:
    digests = read_package_manifest(folder)["files"]
    files: dict[str, Path] = {}
    for file in sorted(folder.rglob("*")):
        if file.is_file():
            files[file.relative_to(folder).as_posix()] = file
    for name, digest in digests.items():
        if name not in files:
            yield PackageCheck("hash", name, good=False, detail="missing")
        elif file_sha256(files[name]) == digest:
            yield PackageCheck("hash", name, good=True, detail="same")
        else:
            yield PackageCheck("hash", name, good=False, detail="changed")
    for name in files:
        if name not in digests and name not in (MANIFEST, SIGNATURE):
            yield PackageCheck("hash", name, good=False, detail="not of the package")
