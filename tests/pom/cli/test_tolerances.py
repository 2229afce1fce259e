"""``aeromatch pom tolerances``, and a tolerance table of the user from command to manifest."""

import hashlib
import json
import sys
from types import SimpleNamespace

import pytest

import pom
from aeromatch.cli.command import main


@pytest.fixture
def aeromatch(tmp_path, monkeypatch, capsys):
    def call(*words):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["aeromatch", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        output = capsys.readouterr()
        return SimpleNamespace(returncode=ended.value.code, stdout=output.out, stderr=output.err)

    return call


def widen(path):
    text = path.read_text()
    row = "2.c.10,Short period dynamics,pitch_angle,pitch,trace,absolute,-1.5,1.5"
    assert row in text
    path.write_text(text.replace(row, row.replace("1.5", "9")))


def test_editions_are_listed_copied_and_compared(aeromatch, tmp_path):
    done = aeromatch("pom", "tolerances", "--write", "own.csv")
    assert "EASA CS-FSTD(A) Issue 2" in done.stdout
    widen(tmp_path / "own.csv")
    done = aeromatch(
        *("pom", "tolerances", "own.csv", "--compare", "aeromatch a2a 2014", "own a2a 2014")
    )
    assert done.returncode == 0, done.stderr
    assert "1.5 deg  9 deg" in done.stdout
    assert "1 difference; 76 tests in both, 0 only in the old, 0 only in the new" in done.stdout
    done = aeromatch("pom", "tolerances", "--compare", "a2a", "easa")
    assert done.returncode == 2
    assert "give more of its words" in done.stderr
    (tmp_path / "own.csv").write_text("standard;edition\n")
    assert aeromatch("pom", "tolerances", "own.csv").returncode == 2


@pytest.mark.slow
def test_a_table_is_named_on_the_pages_and_hashed(aeromatch, write_case, toy, lag_states, tmp_path):
    case = write_case(more="trim = false")
    lag_states.to_netcdf(tmp_path / "record.nc", engine="h5netcdf")
    aeromatch("pom", "tolerances", "--write", "own.csv")
    widen(tmp_path / "own.csv")
    done = aeromatch(
        *("pom", "run", case, "--tolerances", "own.csv", "--model", f"toy={toy()}"),
        *("-o", "out", "--no-pdf"),
    )
    assert "pitch_angle 9 deg in own.csv, 1.5 deg" in done.stdout
    digest = hashlib.sha256((tmp_path / "own.csv").read_bytes()).hexdigest()
    inputs = json.loads((tmp_path / "out" / "manifest.json").read_text())["predicate"]
    listed = inputs["buildDefinition"]["resolvedDependencies"]
    assert {"own.csv": digest}.items() <= {x["name"]: x["digest"]["sha256"] for x in listed}.items()
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert f"tolerances of own.csv (sha256 {digest[:12]})" in page
    assert {item.state for item in pom.verify(tmp_path / "out")} == {"same"}
    widen_more = (tmp_path / "own.csv").read_text().replace("-9,9", "-8,8")
    (tmp_path / "own.csv").write_text(widen_more)
    changed = [item.name for item in pom.verify(tmp_path / "out") if item.state != "same"]
    # the table, and the case that it judges
    assert changed == ["own.csv", "a_case"]
