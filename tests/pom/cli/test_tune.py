"""``aeromatch pom tune`` from the command line: what it writes, what it refuses, and the chapter of
the report.
"""

import json
import re

import numpy as np
import pytest
import xarray as xr

import aerodb
import flightmech
import pom
from flightmech import terms
from flightmech.errors import AeromatchError, SchemaError
from pom.cli.actions.evidence import open_evidence
from pom.diagnosis.tuning.demands import demand_evidence
from pom.diagnosis.tuning.tuning_log import read_log

PULSE = [(0.0, 0.0), (2.0, 0.0), (2.06, -0.06), (4.0, -0.06), (4.06, 0.0)]


@pytest.fixture
def aeromatch(tmp_path, monkeypatch):
    from click.testing import CliRunner

    from pom.cli.group import pom as group

    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(group, [*map(str, words)])


def uncertain(db, share):
    """Return `db` with standard errors of a share of the largest value of the terms of pitch."""
    leaves = aerodb.terms(db)
    names = [name for name in leaves if name.split("/")[0] in ("CL", "CD", "Cm")]
    new = {
        n: leaves[n].assign(
            stderr=xr.full_like(leaves[n]["value"], share * float(abs(leaves[n]["value"]).max()))
        )
        for n in names
    }
    return aerodb.replace_terms(db, new)


def from_flight(leaf):
    """Return a term all of whose nodes are from flight."""
    code = np.full(leaf["value"].shape, terms.SOURCES.index("flight"), np.uint8)
    return leaf.assign(source=(leaf["value"].dims, code, terms.source_attributes(code)))


def test_evidence_needs_nodes_from_flight(trainer, tmp_path):
    db = uncertain(trainer.database(), 0.05)
    aerodb.save(db, tmp_path / "prior.nc")
    with pytest.raises(SchemaError, match="no node of its tables is from flight"):
        open_evidence(tmp_path / "prior.nc")
    flown = aerodb.replace_terms(db, {"Cm/qhat": from_flight(aerodb.terms(db)["Cm/qhat"])})
    aerodb.save(flown, tmp_path / "final.nc")
    assert "Cm/qhat" in aerodb.terms(open_evidence(tmp_path / "final.nc"))


def test_terms_that_the_model_lacks_and_rationales_without_a_name(trainer):
    model = uncertain(trainer.database(), 0.05)
    leaf = aerodb.terms(model)["Cm/qhat"]
    evidence = aerodb.replace_terms(model, {"Cm/first": leaf, "Cm/second": leaf})
    with pytest.raises(SchemaError) as caught:
        demand_evidence(model, evidence, {"Cm/elevator": "x"})
    rationale, missing = caught.value.problems
    assert "Cm/elevator: the rationale is 'x'; write who allows it, when and why" in rationale
    assert missing.startswith("the evidence has 2 terms that the model lacks (Cm/first, Cm/second)")
    assert "--database" in missing
    demand_evidence(model, model, {"Cm/elevator": "A. Bell, 2026-11-28, horn changed"})


@pytest.fixture(scope="module")
def record(trainer):
    return trainer.flight(trainer.database(), duration=9.5, delta_e=PULSE)


@pytest.fixture
def files(write_case, trainer, record, tmp_path):
    """A case with its record and aircraft, and the true database with standard errors."""
    aerodb.save(uncertain(trainer.database(), 0.05), tmp_path / "model.nc")
    case = write_case(case='aircraft = "trainer.toml"')
    record.to_netcdf(tmp_path / "record.nc", engine="h5netcdf")
    (tmp_path / "trainer.toml").write_text(trainer.TOML)
    return [case, "--jobs", 1, "--database", "model.nc"]


@pytest.mark.slow
def test_cases_that_pass_move_nothing(aeromatch, files, tmp_path):
    done = aeromatch("tune", *files, "-o", "tuned")
    assert done.exit_code == 0, done.output
    lines = done.output.splitlines()
    assert lines[0] == "nothing moved: no row fails"
    assert lines[-1] == "written: tuned"
    assert {file.name for file in (tmp_path / "tuned").iterdir()} == {
        "tuned.nc",
        "tuned.toml",
        "tuning.json",
        "tuning.txt",
    }
    log = read_log(tmp_path / "tuned" / "tuning.json")
    assert (log["moves"], log["distance"], log["files"]["database"]["name"]) == (
        [],
        0.0,
        "model.nc",
    )
    assert log["rows"][0]["before"] == log["rows"][0]["after"] == "pass"


BAD = [
    (["--fmu"], "--fmu needs -o"),
    (["-o", "tuned", "--row", "a_cse"], "unknown case 'a_cse'; near it: a_case"),
    (
        ["-o", "tuned", "--row", "a_case", "--rationale", "Cm/elevater=worn"],
        "unknown term with standard errors 'Cm/elevater'; near it: Cm/elevator",
    ),
    (
        ["-o", "tuned", "--rationale", "Cm/elevator="],
        "Cm/elevator: the rationale is ''; write who allows it",
    ),
    (["-o", "tuned", "--rationale", "trainer.toml"], r"one table \[rationale\] is needed"),
    (
        ["-o", "tuned", "--rationale", "Cm/qhat=a", "--rationale", "Cm/qhat=b"],
        "Cm/qhat: has two rationales",
    ),
    (
        ["-o", "tuned", "--database", "trainer.toml"],
        "no netCDF-4 .* a database, as `aeromatch db build` writes it",
    ),
    (["-o", "tuned", "--database", "bare.nc"], "no term has standard errors"),
    (["-o", "tuned", "--evidence", "model.nc"], "no node of its tables is from flight"),
    (
        ["-o", "tuned", "--evidence", "coarse.nc"],
        "Cm/basic: the evidence has other breakpoints than the model",
    ),
]


@pytest.mark.nightly
def test_bad_input_is_named(aeromatch, files, trainer, tmp_path):
    db = uncertain(trainer.database(), 0.05)
    aerodb.save(trainer.database(), tmp_path / "bare.nc")
    coarse = aerodb.terms(db)["Cm/basic"].isel(alpha=[0, 3])
    aerodb.save(aerodb.replace_terms(db, {"Cm/basic": from_flight(coarse)}), tmp_path / "coarse.nc")
    for words, text in BAD:
        done = aeromatch("tune", *files, *words)
        message = done.output if isinstance(done.exception, SystemExit) else str(done.exception)
        assert done.exit_code != 0
        assert re.search(text, message), message
        assert not (tmp_path / "tuned").exists()


@pytest.mark.nightly
def test_a_model_that_cannot_be_flown_is_named(aeromatch, files, trainer, tmp_path):
    aerodb.save(
        uncertain(trainer.scaled(trainer.database(), Cm_qhat=-100.0), 0.05), tmp_path / "wild.nc"
    )
    done = aeromatch("tune", *files, "--database", "wild.nc", "--row", "a_case")
    assert re.search(
        "a_case: the model cannot be flown or judged: .* is not finite at t = ", str(done.exception)
    )
    done = aeromatch("tune", *files, "--database", "wild.nc")
    assert done.exit_code == 0
    assert done.output.splitlines()[0].startswith(
        "nothing moved: no row fails; "
    )  # so that none is wanted
    assert re.match(".*; invalid a_case$", done.output.splitlines()[0], re.IGNORECASE)
    done = aeromatch("tune", *files, "--row", "a_case")
    assert done.output.splitlines()[0] == "nothing moved: the wanted rows pass as they are"


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("[", "no JSON text"),
        ("[]", "kind is None"),
        ('{"kind": "log of aeromatch pom tune, 1", "rows": [{}]}', r"rows\[0\] lacks after"),
    ],
)
def test_what_is_no_log_is_refused(content, text, tmp_path):
    (tmp_path / "log.json").write_text(content)
    with pytest.raises(AeromatchError, match=text):
        read_log(tmp_path / "log.json")


@pytest.mark.nightly
def test_refusal_price_rationale_and_report(aeromatch, files, trainer, tmp_path):
    """The elevator is off by fifteen of its standard errors: refused with the price, done with a
    rationale, and reported.
    """
    model = uncertain(trainer.scaled(trainer.database(), Cm_elevator=0.7), 0.02)
    aerodb.save(model, tmp_path / "model.nc")
    refused = aeromatch("tune", *files, "-o", "tuned", "--log", "refusal.json")
    assert refused.exit_code == 1, refused.output
    assert (
        "refused: a_case: cannot pass within 2 standard errors; it would take Cm/elevator"
        in refused.output
    )
    assert not (tmp_path / "tuned").exists()
    price = json.loads((tmp_path / "refusal.json").read_text())
    assert {move["term"]: move["moved"] for move in price["moves"]}["Cm/elevator"] > 2.0
    assert f"distance {price['distance']:.1f}" in refused.output
    with pytest.raises(AeromatchError, match="the log of a refusal"):
        read_log(tmp_path / "refusal.json")

    (tmp_path / "why.toml").write_text(
        '[rationale]\n"Cm/elevator" = "A. Bell, 2026-11-28, the horn was changed after the flights"\n'
    )
    done = aeromatch("tune", *files, "--rationale", "why.toml", "-o", "tuned", "--fmu", "--json")
    assert done.exit_code == 0, done.output
    log = json.loads(done.stdout)
    assert log == read_log(tmp_path / "tuned" / "tuning.json")
    (row,) = log["rows"]
    assert (row["before"], row["after"], row["wanted"]) == ("fail", "pass", True)
    tuned = aerodb.open(tmp_path / "tuned" / "tuned.nc")
    leaf = aerodb.terms(tuned)["Cm/elevator"]
    assert "pom tune for a_case: 1 of 1 nodes moved" in leaf.attrs["history"]
    assert "the horn was changed" in leaf.attrs["history"]
    assert np.array_equal(
        aerodb.terms(aerodb.store.undo_edits(tuned))["Cm/elevator"]["value"],
        aerodb.terms(model)["Cm/elevator"]["value"],
    )

    flightmech.write_fmu(
        flightmech.compile(flightmech.read_aircraft("trainer.toml"), model), "before.fmu"
    )
    words = [
        "run",
        files[0],
        "--jobs",
        1,
        "--model",
        "before=before.fmu",
        "--model",
        "tuned=tuned/tuned.fmu",
        "--no-pdf",
        "-o",
        "report",
    ]
    wrong = aeromatch(*words, "--tuning", "before=tuned/tuning.json")
    assert "before.fmu does not hold the tables that tuned/tuning.json states" in str(
        wrong.exception
    )
    flown = aeromatch(*words, "--tuning", "tuned=tuned/tuning.json")
    assert flown.exit_code == 1, flown.output  # the model before fails
    assert {item.state for item in pom.verify(tmp_path / "report")} == {"same"}
    assert json.loads((tmp_path / "report" / "results.json").read_text())["tunings"]["tuned"] == log
