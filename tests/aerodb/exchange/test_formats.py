"""Tests of the table of formats, with a format of another package."""

from pathlib import Path

import pytest
from click.testing import CliRunner

import aerodb
from aerodb.cli.exchange import ExportFormat
from aerodb.cli.group import db
from aerodb.exchange.formats import EXPORTERS, find_exporter, recognise_format
from flightmech.errors import AeromatchError, AeromatchWarning, ParseError
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


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("return head.startswith(START)", "raise ValueError('no licence')", "no licence"),
        ("return head.startswith(START)", "raise SystemExit('no licence')", "no licence"),
        ("import aerodb", "import no_such_module", "ModuleNotFoundError"),
    ],
)
def test_a_broken_importer_is_left_out(small, tmp_path, add_distribution, old, new, words) -> None:
    """It has a name before that of the importer that reads the file."""
    add_distribution(
        "broken-format",
        {DATABASE_IMPORTERS: {"broken": "broken_format:importer"}},
        broken_format=PACKED.replace(old, new),
    )
    add_distribution("packed-format", GROUPS, packed_format=PACKED)
    aerodb.save(small, tmp_path / "small.nc")
    (tmp_path / "x").write_bytes(b"PACKED DATABASE\n" + (tmp_path / "small.nc").read_bytes())
    with pytest.warns(AeromatchWarning, match=f"left out: .*'broken' .*{words}"):
        assert recognise_format(tmp_path / "x") == "packed"
    (tmp_path / "y").write_bytes(b"something else\n")
    with pytest.warns(AeromatchWarning), pytest.raises(ParseError, match="something"):
        recognise_format(tmp_path / "y")


def test_an_importer_that_cannot_read_its_file_is_named(tmp_path, add_distribution) -> None:
    add_distribution("packed-format", GROUPS, packed_format=PACKED.replace("inner.write", "no."))
    (tmp_path / "x").write_bytes(b"PACKED DATABASE\n")
    with pytest.raises(AeromatchError, match="the importer 'packed' of another package fails at"):
        run("import", str(tmp_path / "x"), "-o", str(tmp_path / "x.nc"))
