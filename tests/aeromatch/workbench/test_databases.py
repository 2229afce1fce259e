"""Data of the page of the databases: files, terms, tables on common axes, estimates, comparison;
edits are verbs.
"""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

sys.path.insert(0, str(Path(__file__).parent))
from databases_bench import DATCOM, DEG, EDITED, FINAL, flown, project_with_databases

import aerodb
from aeromatch.workbench import databases
from aeromatch.workbench.opened import OpenProject
from flightmech.errors import SchemaError, UnknownName


@pytest.fixture
def opened(tmp_path):
    return OpenProject(*project_with_databases(tmp_path))


def term(opened, name, *files):
    return databases.show_term(opened, {"term": name, "files": ",".join(files)}, None)


def test_files_are_databases_with_their_aircraft(opened):
    match = opened.work / "match"
    shutil.copy(match / "final.nc", match / "final_engine1.nc")
    (match / "final.toml").touch()
    for name in ("databases/edited", "databases/edited_engine1", "tuned/one/model"):
        (opened.work / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(match / "final.nc", opened.work / f"{name}.nc")
    rows = databases.list_databases(opened, {}, None)["files"]
    assert [row["file"] for row in rows] == [DATCOM, FINAL, EDITED, "{work}/tuned/one/model.nc"]
    assert {row["aircraft"] for row in rows} == {"{work}/match/final.toml"}
    (match / "final.toml").unlink()
    assert (
        databases.list_databases(opened, {}, None)["files"][0]["aircraft"]
        == "{project}/aircraft.toml"
    )


@pytest.mark.slow
def test_terms_and_history_of_a_database(opened):
    found = databases.show_database(opened, {"file": FINAL}, None)
    basic, flap, qhat = found["terms"]
    assert [row["term"] for row in found["terms"]] == ["CL/basic", "CL/flap", "Cm/qhat"]
    assert basic["size"] == 28
    assert basic["coefficient"] == "CL"
    assert basic["source"] == {"datcom": 1.0}
    assert [(axis["name"], axis["unit"], len(axis["points"])) for axis in basic["axes"]] == [
        ("mach", "", 7),
        ("alpha", "deg", 4),
    ]
    np.testing.assert_allclose(qhat["axes"][0]["points"], [0, 4, 8])
    assert qhat["regressors"] == ["qhat"]
    assert flap["stderr"] is None
    assert found["undo"] == 0
    edited = aerodb.edit.scale(
        aerodb.open(opened.work / "match" / "final.nc"), "CL/flap", 1.1, note="why"
    )
    aerodb.save(edited, opened.work / "match" / "final.nc")
    again = databases.show_database(
        opened, {"file": FINAL}, None
    )  # the file has changed: it is read again
    assert again["undo"] == 1
    assert again["history"][-1] == {"edit": 1, "text": "scale: CL/flap by 1.1 (why)"}


@pytest.mark.slow
def test_a_database_that_is_none_of_the_working_folder_is_refused(opened):
    with pytest.raises(UnknownName, match=r"match/other\.nc"):
        databases.show_database(opened, {"file": "{work}/match/other.nc"}, None)
    with pytest.raises(UnknownName, match="unknown database"):
        databases.show_database(opened, {"file": str(opened.work / "match" / "final.nc")}, None)


@pytest.mark.nightly
def test_a_term_of_two_databases_on_the_breakpoints_of_both(opened):
    prior = opened.work / "match" / "datcom.nc"
    aerodb.save(
        aerodb.edit.regrid(
            aerodb.open(prior), "Cm/qhat", {"alpha": np.array([0.0, 2.0, 8.0]) * DEG}
        ),
        prior,
    )
    found = term(opened, "Cm/qhat", FINAL, DATCOM)
    np.testing.assert_allclose(found["axes"][0]["points"], [0, 2, 4, 8])
    final, datcom = found["curves"]
    np.testing.assert_allclose(
        final["value"], [-49.0, -49.5, -50.0, -48.0]
    )  # a straight line between the nodes
    np.testing.assert_allclose(datcom["value"], [-18.0, -17.5, -17.0, -16.0])
    np.testing.assert_allclose(found["nodes"]["value"], [-49.0, -50.0, -48.0])
    np.testing.assert_allclose(found["nodes"]["stderr"], [1.0, 0.5, 2.0])
    assert found["nodes"]["source"] == ["flight"] * 3
    assert found["lacking"] == []
    assert found["file"] == FINAL


@pytest.mark.slow
def test_estimates_stand_where_the_term_is_a_derivative(opened):
    found = term(opened, "Cm/qhat", FINAL)["points"]
    assert (
        found["of"]
        == "Cm per qhat, which holds that per alphadothat: the fits do not separate the two"
    )
    assert [
        (row["value"], row["stderr"], row["clean"], row["configuration"]) for row in found["rows"]
    ] == [
        (-52.0, 1.5, True, "clean"),
        (-55.0, 2.5, False, "flaps 40 deg"),
    ]
    np.testing.assert_allclose([row["at"]["alpha"] for row in found["rows"]], [4.0, 6.0])
    assert term(opened, "CL/basic", FINAL)["points"] == {
        "rows": [],
        "of": "CL",
        "kind": "partial",
    }  # too few samples
    (opened.work / "match" / "flown.nc").unlink()
    assert term(opened, "Cm/qhat", FINAL)["points"]["rows"] == []


@pytest.mark.nightly
def test_partial_residuals_stand_where_the_term_is_no_derivative(opened):
    """Of the lift by the flaps, by manoeuvre; another database takes other terms off."""
    file = opened.work / "match" / "flown.nc"
    tree = {name: node.to_dataset() for name, node in flown().children.items()}
    alpha = np.linspace(-2.0, 6.0, 20) * DEG
    lift = (
        0.2 + 5.0 * alpha * 1.25 + 0.3
    )  # of the database at Mach 0.25 with full flaps, and 0.1 more
    samples = {
        "manoeuvre": np.zeros(20, int),
        "time": 0.1 * np.arange(20),
        "alpha": alpha,
        "CL": lift + 0.1,
        "mach": np.full(20, 0.25),
    }
    rest = {"h": 1500.0, "h_agl": 1500.0, "delta_f": 40 * DEG, "gear": 0.0, "speedbrake": 0.0}
    samples |= {name: np.full(20, value) for name, value in rest.items()}
    tree["samples"] = xr.Dataset({name: ("row", values) for name, values in samples.items()})
    tree["manoeuvres"] = tree["manoeuvres"].assign(
        record=("row", ["run"]), label=("row", ["doublet elevator"])
    )
    xr.DataTree.from_dict(
        {
            "/": xr.Dataset(attrs={"title": "flown"}),
            **{f"/{name}": one for name, one in tree.items()},
        }
    ).to_netcdf(file, engine="h5netcdf")
    (row,) = term(opened, "CL/flap", FINAL)["points"]["rows"]
    assert (row["fit"], row["clean"], row["configuration"]) == (
        "run: doublet elevator",
        False,
        "flaps 40 deg",
    )
    assert row["value"] == pytest.approx(0.4, abs=1e-9)
    assert row["at"] == {"delta_f": pytest.approx(40.0)}
    other = opened.work / "match" / "datcom.nc"
    aerodb.save(aerodb.edit.scale(aerodb.open(other), "CL/basic", 0.0), other)
    (row,) = term(opened, "CL/flap", DATCOM)["points"]["rows"]
    assert row["value"] == pytest.approx(float(np.mean(lift)) + 0.1, rel=1e-6)


@pytest.mark.nightly
def test_a_term_that_one_database_lacks(opened):
    final = opened.work / "match" / "final.nc"
    aerodb.save(aerodb.delete_terms(aerodb.open(final), "CL/flap"), final)
    found = term(opened, "CL/flap", FINAL, DATCOM)
    assert found["file"] == DATCOM
    assert found["lacking"] == [FINAL]
    assert len(found["curves"]) == 1
    assert found["nodes"]["stderr"] is None
    with pytest.raises(UnknownName, match="CL/slat"):
        term(opened, "CL/slat", FINAL)


@pytest.mark.slow
def test_tables_that_are_too_large_together_are_refused(opened, monkeypatch):
    monkeypatch.setattr(databases, "_MOST_NODES", 27)
    with pytest.raises(SchemaError, match="have 28 nodes, at most 27 are drawn"):
        term(opened, "CL/basic", FINAL, DATCOM)


@pytest.mark.slow
def test_comparison_is_that_of_the_library_and_made_once(opened, monkeypatch):
    found = databases.compare_databases(opened, {"a": DATCOM, "b": FINAL}, None)
    frame = aerodb.compare(
        *(aerodb.open(opened.work / "match" / f"{name}.nc") for name in ("datcom", "final"))
    )
    row = next(row for row in found["rows"] if row["term"] == "Cm/qhat")
    assert row["max_difference"] == frame.loc["Cm/qhat", "max_difference"] == -33.0
    assert row["max_in_stderr"] == 33.0 / 4.0
    assert row["max_in_stderr_b"] == 33.0 / 0.5
    assert row["location"] == "alpha 4 deg"
    monkeypatch.setattr(aerodb, "compare", None)
    assert databases.compare_databases(opened, {"a": DATCOM, "b": FINAL}, None) == found


@pytest.mark.nightly
def test_a_node_set_in_the_page_goes_to_history_and_log(tmp_path):
    pytest.importorskip("starlette")
    pytest.importorskip("uvicorn")
    from bench import served

    project, work = project_with_databases(tmp_path)
    with served(project, work) as client:
        words = [
            "db",
            "edit",
            FINAL,
            "set",
            "Cm/qhat",
            "--at",
            "alpha=4 deg",
            "--value",
            "-51",
            "--note",
            "run 7",
            "-o",
            EDITED,
        ]
        assert client.act(*words)["state"] == "done"
        found = client.data("/api/term", {"term": "Cm/qhat", "files": EDITED})
        assert found["nodes"]["value"] == [-49.0, -51.0, -48.0]
        assert found["nodes"]["source"] == ["flight", "judgement", "flight"]
        assert (
            client.data("/api/database", {"file": EDITED})["history"][-1]["text"]
            == "set_nodes: Cm/qhat at alpha 4 deg to -51, was -50 (run 7)"
        )
        assert client.act("db", "previous", EDITED, "--steps", "1", "-o", EDITED)["state"] == "done"
        assert client.data("/api/term", {"term": "Cm/qhat", "files": EDITED})["nodes"]["value"] == [
            -49.0,
            -50.0,
            -48.0,
        ]
        assert len(client.data("/api/actions")["actions"]) == 2
        assert client.ask("/api/database", {"file": "{work}/match/none.nc"})[0] == 400
