"""The report without a browser: files, numbers, escapes, coverage."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest
import report_fixture as fixture
from report_pages import html, page, set_rows, texts, write

import pom
from flightmech.errors import SchemaError, UnknownName
from pom.report import overview
from pom.report.case import page as case
from pom.report.presentation import verdict_text
from pom.tolerances.bands import RowRemark, reason_remarks
from pom.tolerances.editions import titles_of_tests
from pom.tolerances.rows import EDITION, STANDARD


class TableParser(HTMLParser):
    """Text of the page by row of the verdict tables."""

    def __init__(self):
        super().__init__()
        self.rows, self.key, self.case, self.row = {}, None, "", None

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        if tag == "article":
            self.case = found["id"].removeprefix("case-")
        if tag == "tr":
            self.row = (
                (self.case, found["data-criterion"], found["data-run"])
                if "data-criterion" in found
                else None
            )
            if self.row:
                self.rows[self.row] = ""

    def handle_data(self, data):
        if self.row:
            self.rows[self.row] += data + " "

    def handle_endtag(self, tag):
        if tag == "tr":
            self.row = None


@pytest.mark.nightly
def test_equal_input_gives_equal_bytes(tmp_path):
    first, second = write(tmp_path / "a"), write(tmp_path / "b")
    assert first.read_bytes() == second.read_bytes()
    assert (tmp_path / "a/results.json").read_bytes() == (tmp_path / "b/results.json").read_bytes()


HELD = 10_000  # more than a list of few cases has, less than their packed pages


@pytest.mark.slow
def test_every_verdict_of_the_page_is_the_one_in_json(report):
    html, document = report
    table = TableParser()
    table.feed(html)
    count = 0
    for item in document["results"]:
        for row in item["verdict"]:
            text = table.rows[
                (item["case"]["name"], row["criterion"].replace("_", " "), row["run"])
            ]
            assert verdict_text.WORDS[row["verdict"]] in text
            if row["worst_ratio"] is not None:
                assert re.search(rf"\b{row['worst_ratio']:.2f}\b", text), (row["criterion"], text)
            count += 1
    assert count == 21  # 3 criteria x 3 models, twice, and one criterion x 3 models


@pytest.mark.slow
def test_hostile_texts_stay_text(tmp_path):
    from dataclasses import replace

    evil = '</script><script>alert(1)</script><img src=x onerror="alert(2)">&\u2028'
    result = fixture.short_period_result()
    result = replace(
        result, case=replace(result.case, title=evil, description=evil, name=evil), failure=evil
    )
    result.verdict["remarks"] = [(RowRemark("row", evil),)] * len(result.verdict)
    html = write(
        tmp_path, results=[result], title=evil, revision=evil, diagnoses={evil: fixture.diagnosis()}
    ).read_text(encoding="utf-8")
    assert "<script>alert" not in texts(html)
    assert "<img" not in texts(html)
    assert (
        html.count("<script") == html.count("</script>") == 8
    )  # class switch, uPlot, our own; parcels of the case, and of the overview and terms of models
    assert json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))["title"] == evil


@pytest.mark.slow
def test_nothing_points_outside_the_file(report):
    html, _ = report
    assert not re.search(r"""(?:src|href|action)\s*=\s*["'](?!#|data:,)""", html)
    assert not re.search(r"@import|url\((?!#)", html)
    assert "default-src 'none'" in html


def files(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.mark.nightly
def test_a_failed_writing_leaves_the_old_report(tmp_path, monkeypatch):
    folder = tmp_path / "report"
    before = files(write(folder).parent)
    monkeypatch.setattr("os.fsync", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        write(folder, title="another")
    assert files(folder) == before
    assert list(tmp_path.iterdir()) == [folder]  # nothing half written is left behind


@pytest.mark.nightly
def test_a_report_takes_the_place_of_all_files_of_an_earlier_one_and_of_no_others(tmp_path):
    folder = tmp_path / "report"
    write(folder)
    (folder / "report.pdf").write_bytes(b"of an earlier report")
    (folder / "csv" / "gone.csv").write_text("a case that is no more")
    (folder / "manifest.json.minisig").write_text("signed")
    before = set(files(folder))
    write(folder, title="another")
    assert set(files(folder)) == before - {"report.pdf", "csv/gone.csv"}
    assert (folder / "manifest.json.minisig").read_text() == "signed"


@pytest.mark.nightly
def test_a_report_of_several_processes_has_the_bytes_of_one(tmp_path, monkeypatch):
    alone = files(write(tmp_path / "alone", paper="a4", jobs=1).parent)
    monkeypatch.setattr("pom.report.case_parts.LEAST_SHARE", 1)
    monkeypatch.delattr(
        "pom.report.case_parts.case_csv"
    )  # of this process: the others make the parts
    assert files(write(tmp_path / "shared", paper="a4", jobs=2).parent) == alone
    assert {"report.pdf", "results.nc", "csv/roll_response_clean.csv"} <= alone.keys()
    with pytest.raises(NameError):
        write(tmp_path / "here", jobs=1)


@pytest.mark.nightly
def test_a_report_of_processes_in_another_folder_has_the_same_bytes(tmp_path, monkeypatch):
    """Processes that are kept from an earlier call have its working directory; cases may name their
    files by relative paths.
    """
    from joblib import Parallel, delayed

    Parallel(n_jobs=2)(delayed(abs)(-1) for _ in range(2))
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    alone = files(write(tmp_path / "alone", jobs=1).parent)
    monkeypatch.setattr("pom.report.case_parts.LEAST_SHARE", 1)
    assert files(write(tmp_path / "shared", jobs=2).parent) == alone


@pytest.mark.nightly
def test_bad_arguments_are_reported(tmp_path):
    with pytest.raises(SchemaError, match="no results came"):
        pom.write_report([], tmp_path, title="x")
    with pytest.raises(UnknownName, match=r"unknown key of provenance 'comand'; near it: command"):
        write(tmp_path, provenance={"comand": "x"})
    with pytest.raises(UnknownName, match=r"unknown case 'short_period'.*named after cases"):
        write(tmp_path, diagnoses={"short_period": fixture.diagnosis()})


def test_cases_of_one_name_get_addresses_of_their_own():
    result = fixture.roll_result()
    assert case.case_keys([result, result]) == ["roll_response_clean", "roll_response_clean-2"]


def test_names_that_differ_in_case_alone_are_different_files():
    result = fixture.roll_result()
    names = ["Climb", "climb", "climb-2", "CLIMB", "Ramp", "climb 2"]
    cases = [replace(result, case=replace(result.case, name=name)) for name in names]
    found = case.case_keys(cases)
    assert found == ["Climb", "climb-2", "climb-2-2", "CLIMB-3", "Ramp", "climb-2-3"]


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["document", "chapters"])
def test_a_case_is_called_as_a_part_of_the_results(tmp_path, name):
    result = fixture.roll_result()
    given = {
        "title": "T-37",
        "provenance": fixture.PROVENANCE,
        "fits": fixture.fits(),
        "paper": None,
        "jobs": 1,
    }
    pom.write_report(
        [replace(result, case=replace(result.case, name=name))], tmp_path / "out", **given
    )
    found = pom.read_archive(tmp_path / "out")
    assert [one.case.name for one in found.results] == [name]
    assert found.chapters


def test_coverage_states_what_of_an_entry_was_not_judged_and_why():
    results = fixture.results()
    set_rows(
        results[0].verdict,
        "criterion",
        "normal_acceleration",
        verdict="not_tested",
        remarks=reason_remarks("no accelerometer"),
    )
    rows = [
        {"standard": r.case.standard, "edition": r.case.edition, "test_id": i, "title": i}
        for r in results[:1]
        for i in ("2.c.10", "9.z.9")
    ]
    (part,) = overview.table_coverage(results[:1], rows)
    assert [
        (entry["id"], entry["judged"], entry["criteria"], entry["left"]) for entry in part["run"]
    ] == [("2.c.10", 2, 3, [("normal acceleration", "no accelerometer")])]
    assert [entry["id"] for entry in part["missing"]] == ["9.z.9"]


def test_reports_of_many_cases_leave_out_the_figures_for_readers_without_script(monkeypatch):
    monkeypatch.setattr("pom.report.case.page.MOST_WITH_FIGURES", 1)
    result = fixture.roll_result()
    many, few = page([result, result]), page([result])
    assert many.count("<noscript>") == 2
    assert many.count("<figure><svg") == 0
    assert few.count("<figure><svg") == 1


@pytest.mark.slow
def test_a_long_report_packs_each_case_into_a_file(monkeypatch, tmp_path):
    results = [fixture.roll_result()]
    whole = html(results)
    monkeypatch.setattr("pom.report.page.MOST_HELD", HELD)
    parts = html(results)
    ((name, script),) = [item for item in parts.items() if item[0] != "report.html"]
    packed = re.search(r'"([A-Za-z0-9+/=]+)";\n$', script)[1]
    assert list(whole) == ["report.html"]
    assert packed in whole["report.html"]
    assert packed not in parts["report.html"]
    assert f'data-file="{name}"' in parts["report.html"]
    assert "'self'" in parts["report.html"]
    assert "'self'" not in whole["report.html"]  # which loads nothing
    folder = pom.write_report(
        results, tmp_path / "report", title="T-37", revision="A", paper=None
    ).parent
    assert (folder / name).read_text(encoding="utf-8") == script
    assert {item.state for item in pom.verify(folder) if item.name == name} == {"same"}
    monkeypatch.undo()
    pom.write_report(results, folder, title="T-37", paper=None)
    assert not (folder / "pages").exists()


@pytest.mark.nightly
def test_the_page_of_any_number_of_cases_stays_small(monkeypatch):
    case = fixture.roll_result()
    monkeypatch.setattr("pom.report.page.MOST_HELD", HELD)
    long, longer = (len(html([case] * count)["report.html"]) for count in (1, 2))
    monkeypatch.setattr("pom.report.page.MOST_HELD", 0)
    small, many = html([case] * 10), html([case] * 20)
    assert longer > long + 500  # a case is listed in the page itself
    assert len(many["report.html"]) - len(small["report.html"]) < 20  # counts of as many digits
    assert many["pages/index.js"].count('<article class=\\"page case\\"') == 20
    assert "pages/index.js" in many["report.html"]
    assert len(many["report.html"]) + HELD < 3_000_000


def test_coverage_counts_entries_of_the_table(report):
    html, _ = report
    entries = titles_of_tests(STANDARD, EDITION)
    assert f"2 of {len(entries)} entries have a case here" in html
    assert re.search(r'<span class="id">2\.c\.9</span> Phugoid', html)


def test_a_crashed_model_is_reported(report):
    html, _ = report
    assert "Not all models ran.</strong> corrected: the FMU stopped at 6.42 s" in html
