"""Single bytes and single fields of a report, changed: each is found."""

import json
import math
import random
import shutil
from dataclasses import replace as replaced

import h5py
import pytest

import pom
from flightmech.errors import AeromatchError, SchemaError
from pom.archive import origins as manifest
from pom.archive.archive import read_archive
from pom.archive.origins import file_sha256
from pom.cases.case import read_case
from pom.replaying.replay_case import replay
from pom.result import NUMBERS


@pytest.fixture(scope="module")
def untouched(tmp_path_factory):
    """Return the folder that the report of `report` is kept in."""
    return tmp_path_factory.mktemp("untouched")


@pytest.fixture
def folder(untouched, write_case, lag_states, toy, tmp_path):
    """Return a fresh copy of a report with its inputs and its model next to it."""
    if not (untouched / "report").exists():
        case = read_case(write_case(more="trim = false"))
        lag_states.to_netcdf(tmp_path / "record.nc", engine="h5netcdf")
        own = shutil.copy(toy(), tmp_path / "toy.fmu")
        made_from = pom.provenance(case.files(), {"toy": own}, "aeromatch pom run", "2026-11-21")
        made_from["records"] = {"case a_case": "record"}
        result = replay(case, {"toy": toy()}, lag_states)
        pom.write_report(
            [result],
            tmp_path / "report",
            title="Toy",
            provenance=made_from,
            revision="A",
            paper=None,
        )
        shutil.copytree(tmp_path, untouched, dirs_exist_ok=True)
    shutil.copytree(untouched, tmp_path / "copy")
    return tmp_path / "copy"


def found(folder):
    """Whether the verification refuses a report or finds something changed."""
    try:
        return any(item.state != "same" for item in pom.verify(folder / "report"))
    except AeromatchError:
        return True


@pytest.mark.nightly
def test_twenty_single_bytes(folder):
    assert not found(folder)
    drawn = random.Random(7)
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    at = [*files, *drawn.choices(files, k=20 - len(files))]  # every file at least once
    missed = []
    for file in at:
        content = file.read_bytes()
        place = drawn.randrange(len(content))
        file.write_bytes(
            content[:place]
            + bytes([content[place] ^ 1 << drawn.randrange(8)])
            + content[place + 1 :]
        )
        missed += [] if found(folder) else [(file.name, place)]
        file.write_bytes(content)
    assert len(at) == 20
    assert missed == []


DEFINITION = ("predicate", "buildDefinition")
GIVEN, CASE = (*DEFINITION, "externalParameters"), (*DEFINITION, "internalParameters", "cases", 0)
MADE_FROM, RESULT = ("provenance",), ("results", 0)
FIELDS = [
    ("manifest.json", (*GIVEN, "title")),
    ("manifest.json", (*GIVEN, "revision")),
    ("manifest.json", (*GIVEN, "command")),
    ("manifest.json", (*GIVEN, "date")),
    ("manifest.json", (*CASE, "title")),
    ("manifest.json", (*CASE, "window", 0)),
    ("manifest.json", (*CASE, "criteria", 1, "band", "limits", 0, "value")),
    ("manifest.json", (*DEFINITION, "resolvedDependencies", 0, "digest", "sha256")),
    ("manifest.json", ("predicate", "runDetails", "builder", "version", "numpy")),
    ("manifest.json", ("subject", 0, "name")),
    ("results.json", ("title",)),
    ("results.json", ("revision",)),
    ("results.json", (*MADE_FROM, "command")),
    ("results.json", (*MADE_FROM, "records", "case a_case")),
    ("results.json", (*MADE_FROM, "models", "toy", "sha256")),
    ("results.json", (*RESULT, "status", "toy")),
    ("results.json", (*RESULT, "verdict", 0, "verdict")),
    ("results.json", (*RESULT, "verdict", 0, "worst_ratio")),
    ("results.json", (*RESULT, "case", "window", 1)),
    ("results.json", (*RESULT, "case", "edition")),
]


def edited(folder, name, place):
    """Change one field of a file, and its hash in the manifest, as somebody does who wants to hide
    it.
    """
    path = folder / "report" / name
    document = json.loads(path.read_text(encoding="utf-8"))
    item = document
    for key in place[:-1]:
        item = item[key]
    if item[place[-1]] is None:
        item[place[-1]] = 0.25
    elif isinstance(item[place[-1]], float):
        item[place[-1]] += 0.25
    else:
        item[place[-1]] = f"{item[place[-1]]}x"
    path.write_text(json.dumps(document), encoding="utf-8")
    if name != manifest.NAME:
        path = folder / "report" / manifest.NAME
        statement = json.loads(path.read_text(encoding="utf-8"))
        next(item for item in statement["subject"] if item["name"] == name)["digest"]["sha256"] = (
            file_sha256(folder / "report" / name)
        )
        path.write_text(manifest.statement_text(statement), encoding="utf-8")


@pytest.mark.nightly
def test_twenty_fields_with_the_hashes_put_right(folder):
    missed = []
    for name, place in FIELDS:
        before = {
            file: (folder / "report" / file).read_bytes()
            for file in ("manifest.json", "results.json")
        }
        edited(folder, name, place)
        missed += [] if found(folder) else [(name, place)]
        for file, content in before.items():
            (folder / "report" / file).write_bytes(content)
    assert len(FIELDS) == 20
    assert missed == []


@pytest.mark.slow
def test_a_number_in_place_of_none_is_found(folder):
    """A criterion of the whole window has no first exit if it passes."""
    document = json.loads((folder / "report" / "results.json").read_text(encoding="utf-8"))
    places = []
    for i, row in enumerate(document["results"][0]["verdict"]):
        places += [(*RESULT, "verdict", i, name) for name in NUMBERS if row[name] is None]
    assert not found(folder)
    assert places
    edited(folder, "results.json", places[0])
    details = [item.detail for item in pom.verify(folder / "report") if item.state != "same"]
    assert any(f"{places[0][-1]} nan, results.json 0.25" in text for text in details)


@pytest.mark.slow
def test_a_removed_number_is_found(folder):
    """A report whose tables have lost a number is judged again."""
    (result,) = read_archive(folder / "report").results
    verdict = result.verdict.copy()
    verdict.loc[0, "worst_ratio"] = math.nan
    changed = folder / "report2"
    pom.write_report([replaced(result, verdict=verdict)], changed, title="Toy", paper=None)
    details = [item.detail for item in pom.verify(changed) if item.kind == "verdict"]
    assert len(details) == 1
    assert "worst_ratio nan, judged again " in details[0]


@pytest.mark.slow
@pytest.mark.parametrize("number", [math.inf, math.nan, -1.0])
def test_a_time_that_does_not_rise_is_an_error_of_the_file(folder, number):
    """Fits through the samples fail on an infinite time."""
    with h5py.File(folder / "report" / "results.nc", "r+") as file:
        group = next(item for item in file.values() if isinstance(item, h5py.Group))
        time = group["time"][()]
        time[-1] = number
        group["time"][...] = time
    with pytest.raises(SchemaError, match="is not a rising time"):
        read_archive(folder / "report")


@pytest.mark.slow
def test_a_part_that_the_manifest_lacks_is_an_error_of_the_file(folder):
    file = folder / "report" / "manifest.json"
    for part in ("name", "digest"):
        content = json.loads((folder / "report" / "manifest.json").read_text())
        content["subject"][0].pop(part, None)
        file.write_text(json.dumps(content))
        with pytest.raises(SchemaError, match="manifest"):
            pom.verify(folder / "report")


@pytest.mark.slow
@pytest.mark.parametrize("value", ["text", None])
def test_a_column_that_the_results_lack_is_found(folder, value):
    file = folder / "report" / "results.json"
    content = json.loads(file.read_text())
    row = content["results"][0]["verdict"][0]
    del row["worst_ratio"]
    if value:
        row["worst_ratio"] = value
    file.write_text(json.dumps(content))
    details = " ".join(item.detail for item in pom.verify(folder / "report"))
    assert "results.json no number" in details
