"""The comparison of two runs distinguishes changed words from changed numbers."""

import json
import runpy
from pathlib import Path
from zipfile import ZipFile

import pytest
import xarray as xr

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(ROOT / "benchmarks" / "same_results.py"))


@pytest.fixture
def folders(tmp_path):
    for name in ("before", "after"):
        (tmp_path / name).mkdir()
    return tmp_path / "before", tmp_path / "after"


@pytest.mark.parametrize(
    ("one", "other", "kind"),
    [
        ("mass 2150 kg", "mass 2150 kg", "equal"),
        ("mass 2150 kg", "the mass is 2150.0 kg", "words"),
        ("read /a/run1/x.csv: 3", "read /b/run22/y.csv: 3", "words"),
        ("digest 0123456789abcdef", "digest fedcba9876543210", "words"),
        ("mass 2150 kg", "mass 2151 kg", "numbers"),
    ],
)
def test_texts(script, folders, one, other, kind):
    for folder, text in zip(folders, (one, other), strict=True):
        (folder / "a.toml").write_text(text, encoding="utf-8")
    assert script["compare_files"](*(folder / "a.toml" for folder in folders))[0] == kind


@pytest.mark.parametrize(
    ("text", "value", "kind"), [("new", 1.0, "words"), ("old", 1.5, "numbers")]
)
def test_values_of_json_netcdf_and_fmu(script, folders, text, value, kind):
    contents = [("old", 1.0), (text, value)]
    for folder, (word, number) in zip(folders, contents, strict=True):
        document = json.dumps({"title": word, "ratio": number})
        (folder / "a.json").write_text(document, encoding="utf-8")
        xr.Dataset({"x": ("i", [number])}, attrs={"title": word}).to_netcdf(folder / "a.nc")
        with ZipFile(folder / "a.fmu", "w") as archive:
            archive.writestr("modelDescription.xml", document)
            archive.writestr("binaries/a.so", document)
    for name in ("a.json", "a.nc", "a.fmu"):
        found = script["compare_files"](*(folder / name for folder in folders))
        assert found[0] == kind, name


def test_a_missing_file_counts_as_a_difference(script, folders, capsys):
    (folders[0] / "a.csv").write_text("1", encoding="utf-8")
    assert script["main"](*folders) == 1
    assert "missing 1" in capsys.readouterr().out
