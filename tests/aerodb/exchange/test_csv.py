"""Terms as CSV files: strict reading, units in brackets, folders written whole."""

import os
import random

import numpy as np
import pytest
import write_calls
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import aerodb
from aerodb.exchange.tables.csv_text import read_csv, written_csv
from flightmech import terms
from flightmech.errors import ParseError, SchemaError


@pytest.fixture
def folder(small, tmp_path):
    aerodb.exchange.export_csv(small, tmp_path / "terms")
    return tmp_path / "terms"


def edited(file, old, new):
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")


def test_what_stands_in_the_files(folder):
    assert sorted(os.listdir(folder)) == [
        "001_CL_basic.csv",
        "002_CL_qhat.csv",
        "003_CL_flap.csv",
        "004_Cm_qhat.csv",
        "index.csv",
    ]
    assert (folder / "002_CL_qhat.csv").read_text() == (
        "# CL/qhat, value\n# regressors: qhat\n# outside: hold\nmach "
        "[1],value,stderr,source\n0.2,8.0,2.0,datcom\n0.4,8.4,2.1,datcom\n"
    )
    index = (folder / "index.csv").read_text().splitlines()
    assert index[0] == "# aeromatch terms, format 1"
    assert "# S = 16.9" in index
    assert index[-2:] == [
        "003_CL_flap.csv,CL/flap,value,delta_f,,3",
        "004_Cm_qhat.csv,Cm/qhat,value,,qhat,1",
    ]


def test_degrees_are_converted_and_the_history_states_so(small, folder):
    file = folder / "003_CL_flap.csv"
    angle = repr(float(np.radians(40.0)))
    edited(file, "delta_f [rad]", "delta_f [deg]")
    edited(file, angle, "40")
    edited(file, repr(float(np.radians(20.0))), "20")
    found = aerodb.terms(aerodb.exchange.import_csv(folder))["CL/flap"]
    np.testing.assert_allclose(
        found["delta_f"], aerodb.terms(small)["CL/flap"]["delta_f"], rtol=1e-15
    )
    np.testing.assert_array_equal(found["value"], aerodb.terms(small)["CL/flap"]["value"])
    assert found.attrs["history"] == "import_csv: 003_CL_flap.csv gives delta_f in deg"
    assert found["delta_f"].attrs["units"] == "rad"


def test_rows_may_stand_in_any_order(small, folder):
    file = folder / "001_CL_basic.csv"
    lines = file.read_text().splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("mach"))
    rows = lines[head + 1 :]
    random.Random(1).shuffle(rows)
    file.write_text("\r\n".join([*lines[: head + 1], *rows, ""]))
    xr.testing.assert_identical(aerodb.exchange.import_csv(folder), small)


def test_all_faults_are_reported_with_file_and_line(folder):
    edited(folder / "001_CL_basic.csv", "mach [1]", "mach [ft]")
    edited(folder / "002_CL_qhat.csv", "8.4,2.1,datcom", "8,4,2.1,datcom")
    edited(folder / "003_CL_flap.csv", "0.36,0.07,datcom", "none,0.07,guess")
    edited(folder / "004_Cm_qhat.csv", "value,source", "value,sauce")
    edited(folder / "004_Cm_qhat.csv", "# outside: hold", "# outside hold")
    (folder / "more.csv").write_text("a\n")
    with pytest.raises(SchemaError) as caught:
        aerodb.exchange.import_csv(folder)
    assert [problem.split("; ")[0] for problem in caught.value.problems] == [
        "more.csv is not in index.csv",
        "001_CL_basic.csv: column mach [ft]: unit 'ft' cannot be converted to '1'",
        "002_CL_qhat.csv, line 6: 5 cells, the header has 4",
        "003_CL_flap.csv, line 7: value is 'none'",
        "003_CL_flap.csv, line 7: source is 'guess'",
        "004_Cm_qhat.csv, line 3: found '# outside hold'",
        "004_Cm_qhat.csv: column 'sauce'",
    ]


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        (
            "0.4,0.0,",
            "0.2,0.0,",
            r"001_CL_basic.csv, lines 7, 11: the same node mach 0.2 alpha 0; every node stands "
            r"once",
        ),
        ("0.4,0.0,", "0.2,0.0,", r"1 of 8 nodes have no row, the first is mach 0.4 alpha 0"),
        ("0.4,0.0,", "# 0.4,0.0,", r"001_CL_basic.csv, line 11: found '# 0.4,0.0,"),
        (
            "alpha [rad]",
            "alpha",
            r"column 'alpha'; allowed: axes with their unit in brackets, value, stderr, source",
        ),
        ("alpha [rad]", "alfa [rad]", r"axis: unknown quantity 'alfa'; near it: alpha"),
        ("alpha [rad]", "mach [1]", r"the columns mach stand twice"),
        ("value,stderr", "wert,stderr", r"no column 'value'"),
        (
            "value,stderr,source\n",
            "value,stderr,source\n0.9,1e9,nan,nan,datcom\n",
            r"9 rows for 3 x 5 = 15 nodes|6 of 15 nodes have no row",
        ),
    ],
)
def test_a_table_that_is_no_grid_is_reported(folder, old, new, fault):
    edited(folder / "001_CL_basic.csv", old, new)
    with pytest.raises(SchemaError, match=fault):
        aerodb.exchange.import_csv(folder)


def test_a_long_list_of_points_that_is_no_grid_takes_no_memory(folder):
    file = folder / "001_CL_basic.csv"
    rows = "".join(f"{i},{i},1.0,0.1,datcom\n" for i in range(2000))
    head = file.read_text().split("datcom\n")[0].rsplit("\n", 1)[0]
    file.write_text(f"{head}\n{rows}")
    with pytest.raises(
        SchemaError, match="2000 rows for 2000 x 2000 = 4000000 nodes; every node needs a row"
    ):
        aerodb.exchange.import_csv(folder)


def test_the_schema_is_asked_last(folder):
    edited(folder / "002_CL_qhat.csv", "# regressors: qhat", "# regressors: qhut")
    edited(folder / "003_CL_flap.csv", "0.36,0.07", "nan,-1")
    with pytest.raises(SchemaError) as caught:
        aerodb.exchange.import_csv(folder)
    assert [problem.split(";")[0] for problem in caught.value.problems] == [
        "CL/qhat: regressor: unknown quantity 'qhut'",
        "CL/flap: value holds 1 NaN or infinite nodes of 3",
        "CL/flap: stderr holds negative or NaN values",
    ]


@pytest.mark.parametrize(
    ("row", "fault"),
    [
        ("009_CL_none.csv,CL/none,value,,,1", "no file '009_CL_none.csv' in the folder"),
        ("../secret.csv,CL/none,value,,,1", "no file '../secret.csv' in the folder"),
        ("001_CL_basic.csv,CL/basic,value,,,8", "table 'value' of CL/basic; allowed: value once"),
        ("001_CL_basic.csv,CL/more,K1,,,8", "table 'K1' of CL/more; allowed: value once"),
    ],
)
def test_the_index_is_read_strictly(folder, row, fault):
    with (folder / "index.csv").open("a") as file:
        file.write(row + "\n")
    with pytest.raises(SchemaError, match=f"index.csv, line 19: {fault}"):
        aerodb.exchange.import_csv(folder)


def test_folders_that_are_none_of_ours(small, tmp_path):
    with pytest.raises(
        FileNotFoundError,
        match=r"no index.csv there; name a folder that aerodb.exchange.export_csv wrote",
    ):
        aerodb.exchange.import_csv(tmp_path)
    (tmp_path / "index.csv").write_text("a,b\n1,2\n")
    with pytest.raises(ParseError, match="aeromatch terms, format 1"):
        aerodb.exchange.import_csv(tmp_path)
    (tmp_path / "index.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ParseError, match="not valid UTF-16"):
        aerodb.exchange.import_csv(tmp_path)
    (tmp_path / "index.csv").write_bytes(b"")
    with pytest.raises(ParseError, match="no header row"):
        aerodb.exchange.import_csv(tmp_path)
    with pytest.raises(FileExistsError, match="holds other files than an export of terms"):
        aerodb.exchange.export_csv(small, tmp_path)
    with pytest.raises(FileExistsError, match="is a file; name a folder"):
        aerodb.exchange.export_csv(small, tmp_path / "index.csv")


def test_a_folder_of_ours_is_replaced_and_one_with_a_foreign_file_is_not(small, folder):
    fewer = aerodb.make_database({"CL/basic": terms.make_term(1.0)}, **small.attrs)
    aerodb.exchange.export_csv(fewer, folder)
    assert sorted(os.listdir(folder)) == ["001_CL_basic.csv", "index.csv"]
    (folder / "thesis.txt").write_text("years of work")
    with pytest.raises(FileExistsError):
        aerodb.exchange.export_csv(small, folder)
    assert (folder / "thesis.txt").read_text() == "years of work"
    assert os.listdir(folder.parent) == ["terms"]


def test_a_name_that_no_comment_line_takes_is_refused(small, tmp_path):
    small["CL/flap"].attrs["my note"] = "x"
    with pytest.raises(SchemaError, match="CL/flap: attribute 'my note' is not a word"):
        aerodb.exchange.export_csv(small, tmp_path / "terms")
    assert not list(tmp_path.iterdir())


KEYS = st.from_regex(r"[A-Za-z_][A-Za-z0-9_.]{0,8}", fullmatch=True)
TEXTS = st.text(st.characters(codec="utf-8", exclude_characters="\0", exclude_categories=["Cs"]))


@pytest.mark.nightly
@given(st.dictionaries(KEYS, TEXTS | st.integers() | st.floats(allow_nan=False)))
def test_facts_come_back(tmp_path_factory, facts):
    path = tmp_path_factory.getbasetemp() / "facts.csv"
    path.write_text(written_csv("title", facts, ["a"], [["1"]]), encoding="utf-8", newline="")
    table, problems = read_csv(path)
    assert (table.title, dict(table.facts), problems) == ("title", facts, [])


def export_killed_at_each_call(folder):
    """Export one database over another and be killed; the folder is one of the two, and the next
    export removes what the kill left.
    """
    root = {
        "S": 16.9,
        "cbar": 1.667,
        "b": 10.31,
        "x_ref": -3.0,
        "y_ref": 0.0,
        "z_ref": 0.0,
        "force_axes": "stability",
    }
    root |= {
        "aircraft": "test",
        "source": "by hand",
        "history": "by hand",
        "absent": "",
        "title": "killed",
    }
    old, new = (
        aerodb.make_database({f"CL/t{i}": terms.make_term(float(i)) for i in range(n)}, **root)
        for n in (2, 4)
    )
    target = folder / "terms"
    aerodb.exchange.export_csv(old, target)
    seen = []
    for number in write_calls.each_call(lambda: aerodb.exchange.export_csv(new, target), folder):
        there = aerodb.exchange.import_csv(target)
        seen.append("new" if there.identical(new) else "old")
        assert there.identical(new if seen[-1] == "new" else old), f"call {number}"
        aerodb.exchange.export_csv(old, target)
        assert os.listdir(folder) == ["terms"], f"call {number}"
    assert aerodb.exchange.import_csv(target).identical(new)
    assert seen.count("old") > 4
    assert seen.count("new") > 0


@pytest.mark.serial
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and SIGKILL of POSIX")
def test_a_killed_export_leaves_the_old_folder_or_the_new_one(tmp_path):
    write_calls.run_preloaded(export_killed_at_each_call, tmp_path)
