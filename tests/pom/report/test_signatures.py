"""The block of signatures: who signs a case or a report stands on page, PDF and in the numbers; a
signature by hand keeps its room.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

import pom
from flightmech.errors import SchemaError
from pom.cases.signatures import ROLES, signature_rows
from pom.cli.group import pom as group
from pom.report.pdf import content
from pom.result import results_name

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture

SIGNED = {"prepared": {"name": "A. Engineer", "date": "2026-11-20", "organisation": "flight test"}}


def test_rows_have_every_role_and_name_who_signed_before_the_results():
    rows = signature_rows(
        {**SIGNED, "approved": {"name": "B. Chief", "date": "2026-11-22"}}, "2026-11-21"
    )
    assert [row["role"] for row in rows] == list(ROLES)
    assert (rows[0]["name"], rows[0]["date"]) == ("A. Engineer, flight test", "2026-11-20")
    assert rows[0]["remark"] == "before these results of 2026-11-21"
    assert rows[1] == {"role": "checked", "name": "", "date": "", "remark": ""}
    assert (rows[2]["name"], rows[2]["remark"]) == ("B. Chief", "")
    assert signature_rows(SIGNED, "")[0]["remark"] == ""


def test_a_signature_for_other_results_is_marked():
    """The name of the results counts, not the day; a longer or shorter part of the same hash is the
    same; without a name the day counts.
    """
    result = fixture.roll_result()
    name = results_name([result])
    signed = {"prepared": {**SIGNED["prepared"], "results": name}}
    assert signature_rows(signed, "", name)[0]["remark"] == ""
    assert (
        signature_rows({"prepared": {**SIGNED["prepared"], "results": name[:8]}}, "", name)[0][
            "remark"
        ]
        == ""
    )
    assert (
        signature_rows(signed, "2026-11-21", name)[0]["remark"]
        == "before these results of 2026-11-21"
    )
    assert signature_rows(signed, "", "") == signature_rows(SIGNED, "", name)
    again = replace(
        result, case=replace(result.case, signatures=signed, rationale={"roll_rate": "gusts"})
    )
    assert results_name([again]) == name
    verdict = result.verdict.copy()
    verdict.loc[verdict.index[0], "worst_ratio"] *= 1.00001
    other = replace(again, verdict=verdict)
    assert results_name([other]) != name
    on_paper = content.case_content(
        1, "roll", other, fixture.PROVENANCE, None, pom.judging.mode_table(other)
    )
    assert on_paper["results"] == results_name([other])
    assert on_paper["signatures"][0]["remark"].startswith(f"for other results, {name}")


def test_a_case_file_holds_its_signatures(tmp_path):
    root = Path(__file__).parents[3] / "data" / "t37"
    text = (
        (root / "cases" / "22_roll_response.toml")
        .read_text(encoding="utf-8")
        .replace("../", f"{root.as_posix()}/")
    )
    own = tmp_path / "roll.toml"
    own.write_text(text + '\n[signatures.checked]\nname = "C. Reviewer"\ndate = "2026-11-21"\n')
    case = pom.read_case(own)
    assert case.signatures == {
        "checked": {"name": "C. Reviewer", "date": "2026-11-21", "organisation": ""}
    }
    assert pom.PomCase.from_dict(case.to_dict()) == case
    own.write_text(
        text + "\n[signatures.checked]\nname = 'C. Reviewer'\ndate = '2026-11-21'\nresults = "
        "'3f9a12c4d0be'\n"
    )
    assert pom.read_case(own).signatures["checked"]["results"] == "3f9a12c4d0be"
    for wrong, words in (
        ("date = '2026-11-21'\nresults = 'mine'", "results"),
        ("date = 'yesterday'", "not a day; write YYYY-MM-DD"),
        ("date = '2026-11-21'\nrole = 'x'", "role"),
    ):
        own.write_text(text + f"\n[signatures.checked]\nname = 'C. Reviewer'\n{wrong}\n")
        with pytest.raises(SchemaError, match=words):
            pom.read_case(own)
    own.write_text(text + "\n[signatures.pilot]\nname = 'D. Pilot'\ndate = '2026-11-21'\n")
    with pytest.raises(SchemaError, match="pilot"):
        pom.read_case(own)


@pytest.mark.nightly
def test_page_numbers_and_paper_have_the_names(tmp_path):
    result = fixture.roll_result()
    signed = replace(result, case=replace(result.case, signatures=SIGNED))
    provenance = {
        **fixture.PROVENANCE,
        "signatures": {"approved": {"name": "B. Chief", "date": "2026-11-22", "organisation": ""}},
    }
    pom.write_report([signed], tmp_path / "signed", title="T-37", provenance=provenance, jobs=1)
    html = (tmp_path / "signed" / "report.html").read_text(encoding="utf-8")
    assert "Signatures of the report" in html
    assert "<td>B. Chief</td><td>2026-11-22</td>" in html
    numbers = json.loads((tmp_path / "signed" / "results.json").read_text(encoding="utf-8"))
    assert numbers["results"][0]["case"]["signatures"] == SIGNED
    assert numbers["provenance"]["signatures"]["approved"]["name"] == "B. Chief"
    front = content.front_content([signed], ["roll"], "T-37", "", provenance, {})
    assert [row["name"] for row in front["signatures"]] == ["", "", "B. Chief", ""]
    on_paper = content.case_content(
        1, "roll", signed, provenance, None, pom.judging.mode_table(signed)
    )
    assert on_paper["signatures"][0]["name"] == "A. Engineer, flight test"
    archive = pom.read_archive(tmp_path / "signed")
    assert archive.results[0].case.signatures == SIGNED
    assert [item.state for item in pom.verify(tmp_path / "signed") if item.kind == "statement"] == [
        "same"
    ] * 6


@pytest.mark.slow
def test_a_report_is_signed_when_it_is_written_again(tmp_path):
    pom.write_report(
        [fixture.roll_result()],
        tmp_path / "old",
        title="T-37",
        provenance=fixture.PROVENANCE,
        paper=None,
        jobs=1,
    )
    words = ["report", str(tmp_path / "old"), "-o", str(tmp_path / "new"), "--no-pdf"]
    done = CliRunner().invoke(
        group,
        [
            *words,
            "--sign",
            "prepared",
            "A. Engineer",
            "2026-11-21",
            "--sign",
            "approved",
            "B. Chief",
            "2026-11-22",
        ],
    )
    assert done.exit_code == 0, done.output
    archive = pom.read_archive(tmp_path / "new")
    signed = archive.provenance["signatures"]
    assert (
        {one["results"] for one in signed.values()}
        == {results_name([fixture.roll_result()])}
        == {results_name(archive.results)}
    )
    assert {role: one["name"] for role, one in signed.items()} == {
        "prepared": "A. Engineer",
        "approved": "B. Chief",
    }
    with pytest.raises(SchemaError, match="signed"):
        CliRunner().invoke(
            group, [*words, "--sign", "signed", "A. Engineer", "2026-11-21"], catch_exceptions=False
        )
