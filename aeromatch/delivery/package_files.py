"""Files of a data package: unpacking, structure and hashes. Nothing in them is read or run."""

from __future__ import annotations

import os
import re
import stat
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from aeromatch.delivery.contents import FLOWN, STATES
from aeromatch.delivery.signing import MANIFEST, SIGNATURE
from flightmech.errors import AeromatchError, ParseError, SchemaError
from flightmech.support.foreign_code.process import printable
from flightmech.support.input_files import file_sha256, json_content

# Largest unpacked size of a zip, and of the manifest. [byte]
_MOST, _LARGEST_MANIFEST = 20_000_000_000, 64_000_000
# Unpacked size against that of the zip; tables of numbers shrink to a tenth at best. [byte]
_SMALL, _MOST_TIMES = 100_000_000, 100
# Greatest number of files: a package has one hundred.
_MOST_FILES = 100_000
_DIGEST = re.compile(r"[0-9a-f]{64}")
# Every package has these files, so that a check is not avoided by leaving its file out.
_NEEDED = (
    "aircraft/final.toml",
    "database/final.nc",
    "models/final.fmu",
    "report/manifest.json",
    STATES,
)
# These are left out only if the manifest states the reason.
FORMATS = (
    "database/final.mat",
    "database/final_csv",
    "database/final.dml",
    "database/final_jsbsim.xml",
    FLOWN,
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


@contextmanager
def unpack_package(package: str | Path) -> Iterator[Path]:
    """Yield the folder of a package; a zip is unpacked into a temporary folder.

    Raises
    ------
    SchemaError
        The path is not a data package, or the zip is damaged, too large, has members outside of its
        folder or two of one name.
    """
    package = Path(package)
    if package.is_dir():
        yield _require_manifest(package)
        return
    if not (package.is_file() and zipfile.is_zipfile(package)):
        raise SchemaError(
            str(package), ["neither a folder nor a zip; give what `aeromatch package make` wrote"]
        )
    with tempfile.TemporaryDirectory() as temporary:
        try:
            with zipfile.ZipFile(package) as content:
                _demand_members(content, package)
                content.extractall(temporary)
        except (AeromatchError, OSError):
            raise
        # zipfile and its decoders raise BadZipFile, zlib.error, EOFError, RuntimeError and others
        except Exception as error:
            fault = f"a damaged zip ({str(error)[:100]}); copy it again"
            raise SchemaError(str(package), [printable(fault)]) from None
        root = Path(temporary)
        folders = [item for item in root.iterdir() if item.is_dir()]
        if len(folders) == 1:
            root = folders[0]
        yield _require_manifest(root)


def _demand_members(content: zipfile.ZipFile, package: Path) -> None:
    """Raise unless the members of a zip are as `aeromatch package make` writes them."""
    members = content.infolist()
    # A small zip can unpack to fill the disk.
    size, packed = sum(item.file_size for item in members), package.stat().st_size
    if size > min(_MOST, _SMALL + _MOST_TIMES * packed):
        text = f"unpacks to {size:g} bytes, from {packed:g}; at most {_MOST_TIMES} times as much"
        raise SchemaError(str(package), [text])
    if len(members) > _MOST_FILES:
        raise SchemaError(str(package), [f"{len(members)} files; at most {_MOST_FILES}"])
    seen: set[str] = set()
    for item in members:
        name = item.filename
        if name.startswith("/") or "\\" in name or ".." in Path(name).parts:
            raise SchemaError(str(package), [f"{name!r} leads out of the package"])
        if item.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise SchemaError(str(package), [f"{name!r} is not packed as a data package is"])
        if name in seen:
            raise SchemaError(str(package), [f"two files are named {name!r}"])
        seen.add(name)
    # What lies outside the folder of the package would escape every check.
    folders = {name.split("/")[0] for name in seen}
    if MANIFEST not in seen and len(folders) > 1:
        names = ", ".join(map(repr, sorted(folders)[:4]))
        raise SchemaError(str(package), [f"more than one folder ({names}); a package is one"])


def _require_manifest(folder: Path) -> Path:
    if not (folder / MANIFEST).is_file():
        raise SchemaError(str(folder), [f"no {MANIFEST}; give what `aeromatch package make` wrote"])
    return folder


def read_package_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of a package.

    Raises
    ------
    ParseError
        The file is not a manifest.
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
    return content


def check_structure(folder: Path) -> list[PackageCheck]:
    """Check that a package has regular files with plain names, and all that a package needs.

    A link or a device of a folder would lead the verification to other files.
    """
    manifest = read_package_manifest(folder)
    faults: dict[str, str] = {}
    present: set[str] = set()
    for parent, folders, names in os.walk(folder):
        for name in [*folders, *names]:
            path = Path(parent) / name
            relative = path.relative_to(folder).as_posix()
            present.add(relative)
            mode = path.lstat().st_mode
            if not relative.isprintable():
                faults[repr(relative)] = "a name with control characters"
            elif not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
                faults[relative] = "a link or a device; a package has files and folders only"
        if len(present) > _MOST_FILES:
            faults["files"] = f"more than {_MOST_FILES}"
            break
    for name, digest in manifest["files"].items():
        if not _is_plain(name):
            faults[repr(name)] = f"a name in {MANIFEST} that leads out of the package"
        elif not (isinstance(digest, str) and _DIGEST.fullmatch(digest)):
            faults[name] = f"no SHA-256 in {MANIFEST}"
    for name in _NEEDED:
        if name not in present:
            faults[name] = "missing; every package has it"
    for name in FORMATS:
        if name not in present and not manifest.get("refused", {}).get(name):
            faults[name] = f"missing, and {MANIFEST} states no reason"
    checks = []
    for name, fault in faults.items():
        checks.append(PackageCheck("structure", name, good=False, detail=fault))
    if not checks:
        checks.append(PackageCheck("structure", "files", good=True, detail=f"{len(present)}"))
    return checks


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
