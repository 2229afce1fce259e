"""Tests of the table of formats, with a format of another package."""

from pathlib import Path

import pytest
from click.testing import CliRunner

import aerodb
from aerodb.cli.exchange import ExportFormat
from aerodb.cli.group import db
from aerodb.exchange.formats import EXPORTERS, find_exporter, recognise_format
from flightmech.errors import AeromatchError, ParseError
from flightmech.plugins import DATABASE_EXPORTERS, DATABASE_IMPORTERS

# A format that holds a netCDF file behind a line of its own.
PACKED = """
from pathlib import Path
import aerodb

START = b"PACKED DATABASE\\n"

def export(tree, path):
    inner = Path(path).with_suffix(".inner.nc")
    aerodb.save(tree, inner)
    Path(path).write_bytes(START + inner.read_bytes())
    inner.unlink()

class Importer:
    def recognise(self, path, head):
        return head.startswith(START)

    def read(self, path):
        inner = Path(path).with_suffix(".inner.nc")
        inner.write_bytes(Path(path).read_bytes().removeprefix(START))
        tree = aerodb.open(inner)
        inner.unlink()
        return tree

importer = Importer()
"""
GROUPS = {
    DATABASE_EXPORTERS: {"packed": "packed_format:export"},
    DATABASE_IMPORTERS: {"packed": "packed_format:importer"},
}


def run(*arguments: str):
    return CliRunner().invoke(db, arguments, catch_exceptions=False)


def test_the_command_line_lists_the_exporters() -> None:
    assert list(ExportFormat().choices) == list(EXPORTERS)


def test_a_foreign_format_goes_there_and_back(small, tmp_path: Path, add_distribution) -> None:
    add_distribution("packed-format", GROUPS, packed_format=PACKED)
    aerodb.save(small, tmp_path / "small.nc")
    packed, back = str(tmp_path / "small.packed"), str(tmp_path / "back.nc")
    written = run("export", str(tmp_path / "small.nc"), "--to", "packed", "-o", packed)
    assert written.exit_code == 0, written.output
    read = run("import", packed, "-o", back)
    assert read.stdout.splitlines()[-1] == f"packed: written {back}"
    assert list(aerodb.terms(aerodb.open(back))) == list(aerodb.terms(small))


def test_without_the_package_its_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "small.packed").write_bytes(b"PACKED DATABASE\n")
    with pytest.raises(ParseError, match="the bytes b'PACKED DATABASE"):
        recognise_format(tmp_path / "small.packed")


def test_an_unknown_format_lists_all(add_distribution) -> None:
    add_distribution("packed-format", GROUPS, packed_format=PACKED)
    with pytest.raises(AeromatchError, match=r"use one of netcdf, .*, packed$"):
        find_exporter("zipped")


def test_an_importer_that_fails_is_named(tmp_path: Path, add_distribution) -> None:
    broken = PACKED.replace("return head.startswith(START)", "raise ValueError('no licence')")
    add_distribution("packed-format", GROUPS, packed_format=broken)
    (tmp_path / "x").write_bytes(b"something else\n")
    with pytest.raises(AeromatchError, match=r"'packed' of another package fails .* no licence"):
        recognise_format(tmp_path / "x")
