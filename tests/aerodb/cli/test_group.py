import hashlib
import json
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

import aerodb
from aerodb.cli.group import db
from aerodb.store import overview
from aerodb.store.plausibility_findings import PlausibilityFinding
from flightmech import terms
from flightmech.errors import ParseError, SchemaError, UnknownName


@pytest.fixture
def file(small, tmp_path):
    aerodb.save(small, tmp_path / "small.nc")
    return str(tmp_path / "small.nc")


def run(*arguments):
    return CliRunner().invoke(db, arguments, catch_exceptions=False)


def test_show_prints_one_line_per_term(file):
    lines = run("show", file).stdout.splitlines()
    assert lines[0] == "small database"
    basic = next(line for line in lines if line.startswith("CL/basic"))
    assert "mach[2] 0.2 ... 0.4, alpha[4] -8 ... 16 deg" in basic
    assert "0.05" in basic
    assert basic.endswith("datcom")
    assert "absent: CL/gear CY/rhat" in lines


def test_show_as_json(file):
    found = json.loads(run("show", file, "--json").stdout)
    assert found["attributes"]["S"] == 16.9
    assert [row["term"] for row in found["terms"]] == ["CL/basic", "CL/qhat", "CL/flap", "Cm/qhat"]
    assert found["terms"][1]["regressors"] == ["qhat"]
    mach, alpha = found["terms"][0]["axes"]
    assert mach == {"name": "mach", "points": [0.2, 0.4], "units": "1"}
    assert (alpha["units"], len(alpha["points"])) == ("rad", 4)
    assert found["terms"][0]["source"] == {"datcom": 1.0}


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        (),
        ("--json",),
        *(("--term", name) for name in ("CL/basic", "CL/qhat", "CL/flap", "Cm/qhat")),
    ],
)
def test_show_prints_what_the_whole_reading_prints(file, options, tmp_path):
    """Without its seal a file is one of another program, which is read and checked whole."""
    content = Path(file).read_bytes()
    (tmp_path / "unsealed.nc").write_bytes(content[: content.rindex(b"\noverview")])
    assert (
        run("show", file, *options).stdout
        == run("show", str(tmp_path / "unsealed.nc"), *options).stdout
    )


def resealed(content):
    return (
        content
        + b"\nsha256 of the bytes above: %s\n" % hashlib.sha256(content).hexdigest().encode()
    )


@pytest.mark.slow
@pytest.mark.parametrize("options", [(), ("--json",)])
@pytest.mark.parametrize("kept", [b"", b"\noverview 0: [{}, []]", b"\noverview 1: no JSON"])
def test_without_an_overview_that_it_knows_show_reads_the_terms(file, options, kept, tmp_path):
    """Files of older versions have none, those of later ones may have one of other rules."""
    content = Path(file).read_bytes()
    (tmp_path / "other.nc").write_bytes(resealed(content[: content.rindex(b"\noverview")] + kept))
    assert (
        run("show", file, *options).stdout
        == run("show", str(tmp_path / "other.nc"), *options).stdout
    )


def test_the_overview_is_what_show_prints(file):
    """Sealed by hand, with a name that no term of the content has."""
    content = Path(file).read_bytes()
    content = content[: content.rindex(b"\nsha256 of the bytes above")]
    Path(file).write_bytes(resealed(content.replace(b'"term":"CL/flap"', b'"term":"CL/flop"')))
    assert "CL/flop" in run("show", file).stdout


def describe(leaf):
    return overview.describe_database(xr.DataTree.from_dict({"/CL/qhat": leaf}))


def test_what_the_overview_of_number_1_holds():
    """A change of what `facts` gives, other than for other terms, requires a new number: files
    carry what older rules gave.
    """
    power = terms.PowerFactor("h_agl", -2.0, 0.5)
    leaf = terms.make_term(
        [[1.0, 2.0], [3.0, 5.0]],
        {"mach": [0.1, 0.2], "alpha": [0.0, 0.1]},
        ["qhat"],
        stderr=0.5,
        source="flight",
        power=power,
    )
    axes = [
        {"name": "mach", "points": [0.1, 0.2], "units": "1"},
        {"name": "alpha", "points": [0.0, 0.1], "units": "rad"},
    ]
    row = {
        "term": "CL/qhat",
        "axes": axes,
        "regressors": ["qhat"],
        "power": "max(h_agl, 0.5)^-2",
        "value": [1.0, 5.0],
        "stderr": [0.5, 0.5],
    }
    assert overview.OVERVIEW == "1"
    assert describe(leaf) == [{**row, "source": {"flight": 1.0}}]
    assert describe(terms.make_term(2.0)) == [
        {
            "term": "CL/qhat",
            "axes": [],
            "regressors": [],
            "power": "",
            "value": [2.0, 2.0],
            "stderr": None,
            "source": {},
        }
    ]


def test_a_program_that_changes_the_file_in_place_cuts_the_overview_off(file):
    with h5py.File(file, "a") as changed:
        changed["CL/basic/value"][...] = 7.0
    assert b"overview" not in Path(file).read_bytes()
    assert "7 " in next(
        line for line in run("show", file).stdout.splitlines() if line.startswith("CL/basic ")
    )


def packed(leaf):
    leaf["value"].attrs["scale_factor"] = 2.0


def linked(leaf):
    leaf.move("value", "other")
    leaf["value"] = h5py.SoftLink("/CL/basic/value")


def elsewhere(leaf):
    del leaf["value"]
    leaf.create_dataset("value", (2,), "f8", external=[("elsewhere.bin", 0, 16)])


def endless(leaf):
    del leaf["value"]
    leaf.create_dataset("value", (1 << 40,), "f8", chunks=(1 << 20,))


def without_axis(leaf):
    leaf["value"].dims[0].detach_scale(leaf["delta_f"])


def text(leaf):
    del leaf["value"]
    leaf["value"] = np.array(["a", "b"], dtype=h5py.string_dtype())


def listed(leaf):
    leaf.attrs["regressors"] = np.array([1.0, 2.0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("harm", "fault"),
    [
        (packed, "CL/flap/value is packed"),
        (linked, "CL/flap/value is a link to another place"),
        (elsewhere, "CL/flap/value keeps its numbers in another file"),
        (endless, "CL/flap/value has the shape"),
        (without_axis, "CL/flap/value: dimension 1 has no name"),
        (text, "CL/flap/value holds objects or texts"),
        (listed, "CL/flap: attribute regressors is neither a text nor a number"),
    ],
)
def test_show_states_the_faults_of_a_sealed_file(file, harm, fault):
    """Sealed by hand: content that `save` refuses."""
    content = Path(file).read_bytes()
    Path(file).write_bytes(content[: content.rindex(b"\nsha256 of the bytes above")])
    with h5py.File(file, "a") as changed:
        harm(changed["CL/flap"])
    content = Path(file).read_bytes()
    Path(file).write_bytes(resealed(content))
    with pytest.raises(SchemaError, match=fault):
        run("show", file)


@pytest.mark.nightly
@pytest.mark.parametrize("verb", ["history", "decisions"])
@pytest.mark.parametrize("options", [(), ("--json",)])
def test_history_and_decisions_print_what_the_whole_reading_prints(small, tmp_path, verb, options):
    edited = aerodb.edit.scale(small, "CL/flap", 2.0, note="twice")
    edited["CL/basic"].attrs |= {"decision": "correct", "reason": "by flights"}
    edited["Cm/qhat"]["value"][...] = 0.0  # opened for the flights: to be deleted
    edited["Cm/qhat"]["source"][...] = terms.SOURCES.index("judgement")
    edited["CL/flap"]["source"] = edited["CL/flap"]["value"].astype("u1")
    edited["CL/flap"]["source"][...] = terms.SOURCES.index("flight")
    aerodb.save(edited, tmp_path / "a.nc")
    shown = run(verb, str(tmp_path / "a.nc"), *options).stdout
    # A term from flight without a decision is described by the last line of its history.
    expected = ["correct", "delete", "twice"] if verb == "decisions" else ["twice"]
    assert [text for text in expected if text not in shown] == []
    content = (tmp_path / "a.nc").read_bytes()
    (tmp_path / "a.nc").write_bytes(content[: content.rindex(b"\noverview")])
    assert run(verb, str(tmp_path / "a.nc"), *options).stdout == shown


@pytest.mark.slow
def test_show_one_term_with_its_numbers(file):
    text = run("show", file, "--term", "CL/flap").stdout
    assert "delta_f 40" in text
    assert "0.36" in text
    found = json.loads(run("show", file, "--term", "CL/basic", "--json").stdout)
    assert found["data_vars"]["value"]["dims"] == ["mach", "alpha"]
    with pytest.raises(UnknownName, match="unknown term 'CL/flop'; near it: CL/flap"):
        run("show", file, "--term", "CL/flop")


def test_check(file, tmp_path):
    found = run("check", file)
    assert found.stdout.startswith(f"{file}: implausible, 4 terms, 4 missing, 1 not checked\n")
    assert "CD is implausible (no term: the simulation takes it as zero)" in found.stdout
    assert found.exit_code == 1
    bad = tmp_path / "bad.nc"
    bad.write_bytes(b"nothing")
    with pytest.raises(ParseError, match="no netCDF-4"):
        run("check", str(bad))
    assert run("check", str(tmp_path / "missing.nc")).exit_code == 2


def test_quantities_that_were_not_checked_are_part_of_the_verdict(file, monkeypatch):
    unchecked = PlausibilityFinding("CL/alpha", "not checked", source="no attached angles")
    for findings, verdict in (([], "sound"), ([unchecked], "sound where checked")):
        monkeypatch.setattr(
            "aerodb.cli.actions.group.note_plausibility", lambda tree, _, f=findings: (tree, f)
        )
        printed = run("check", file).stdout
        count = ", 1 not checked" if findings else ""
        assert printed.startswith(f"{file}: {verdict}, 4 terms{count}\n")
        assert json.loads(run("check", file, "--json").stdout)["verdict"] == verdict


AIRCRAFT = """
name = "T-37"
S = "182 ft2"
cbar = "5.47 ft"
b = "33.83 ft"
reference = ["-9.88 ft", 0.0, 0.0]
mass = 2100.0
Ixx = 10826.0
Iyy = 8135.0
Izz = 15162.0
cg = [0.0, 0.0, 0.2235]
"""


@pytest.mark.nightly
def test_build_from_listings(t37_folder, tmp_path):
    toml, output = tmp_path / "t37.toml", tmp_path / "prior.nc"
    toml.write_text(AIRCRAFT)
    listings = [f"--{role}={t37_folder / f't37_{role}.out'}" for role in ("clean", "flaps")]
    result = run("build", str(toml), *listings, "--altitude", "10000 ft", "-o", str(output))
    assert result.exit_code == 0
    assert "warning: flaps: D(CM) comes from a loop" in result.stderr
    assert f"written: {output}" in result.stdout
    built = aerodb.open(output)
    assert "CL/flap" in aerodb.terms(built)
    assert built.attrs["aircraft"] == "T-37"
