"""The report on paper: a PDF/A-3 document with tags, fonts of our own, data attached; its
drawings.
"""

import datetime
import io
import os
import re
import sys
import unicodedata
import zlib
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

import flighttest
import pom
from flightmech.errors import SchemaError, UnknownName
from flightmech.names import VOCABULARY
from pom.judging.measures.modal import mode_table
from pom.report.case.page import run_line_classes
from pom.report.case.panels import Cross, make_case_panels
from pom.report.models.database_comparison import compare_for_report
from pom.report.models.identification import identification_chapter
from pom.report.pdf import case_drawings, content, document, style
from pom.report.pdf import drawings as figure
from pom.report.pdf.cross_plots import cross_drawing
from pom.report.pdf.waterfall import draw_waterfall
from pom.report.presentation.quantities import quantity_label

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture
import report_pages

SVG = "{http://www.w3.org/2000/svg}"
PAPER_WIDTH = {"a4": 210.0, "letter": 215.9}  # mm, ISO 216 and ANSI/ASME Y14.1


def paper(results, form="a4", **more):
    return report_pages.paper(results, form, **{"provenance": fixture.PROVENANCE, **more})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("paper")
    pom.write_report(
        fixture.results(), place, title="T-37", provenance=fixture.PROVENANCE, revision="A"
    )
    return place


def streams(pdf):
    """Yield every stream of a PDF, inflated where it is deflated.

    The line end before ``endstream`` may follow a stream whose own last byte is a carriage return,
    so only the line feed is taken off; an inflater of objects leaves what stands behind the end of
    its data.
    """
    for found in re.finditer(rb"stream\r?\n(.*?)\nendstream", pdf, re.DOTALL):
        try:
            yield zlib.decompressobj().decompress(found.group(1))
        except zlib.error:
            yield found.group(1)


@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_streams_whose_last_byte_is_a_line_end_are_read(end):
    texts = [b"9" * k for k in range(300)]
    packed = {zlib.compress(text)[-1:]: text for text in texts}
    assert {b"\r", b"\n"} <= set(packed)
    for last in (b"\r", b"\n"):
        pdf = b"1 0 obj\nstream" + end + zlib.compress(packed[last]) + end + b"endstream\nendobj"
        assert list(streams(pdf)) == [packed[last]]


def everything(pdf):
    return pdf + b"\n".join(streams(pdf))


def metadata(pdf, name):
    return re.search(rf"<{name}>([^<]*)<".encode(), pdf).group(1).decode()


@pytest.mark.slow
def test_it_is_pdf_a_3b_and_pdf_ua_1(folder):
    pdf = (folder / "report.pdf").read_bytes()
    assert (metadata(pdf, "pdfaid:part"), metadata(pdf, "pdfaid:conformance")) == ("3", "B")
    assert metadata(pdf, "pdfuaid:part") == "1"
    whole = everything(pdf)
    assert b"/StructTreeRoot" in whole
    assert b"/Outlines" in whole


@pytest.mark.nightly
def test_equal_input_gives_equal_bytes(folder, tmp_path):
    pom.write_report(
        fixture.results(), tmp_path, title="T-37", provenance=fixture.PROVENANCE, revision="A"
    )
    for name in (
        "report.pdf",
        "manifest.json",
        "results.nc",
        "results.xml",
        "csv/roll_response_clean.csv",
    ):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


@pytest.mark.slow
def test_fonts_come_from_the_package(folder):
    names = set(
        re.findall(
            rb"/BaseFont/(?:[A-Z]{6}\+)?([\w-]+)",
            re.sub(rb"\s*/", b"/", everything((folder / "report.pdf").read_bytes())),
        )
    )
    assert names
    assert {name.partition(b"-")[0] for name in names} <= {
        b"SourceSansPro",
        b"DejaVuSansMono",
    }  # ours, and one inside typst


def test_results_and_manifest_are_inside(folder):
    inside = list(streams((folder / "report.pdf").read_bytes()))
    assert (folder / "results.json").read_bytes() in inside
    manifest = next(x for x in inside if x.startswith(b"{") and b"in-toto.io" in x)
    assert b"results.nc" in manifest
    assert b"report.pdf" not in manifest  # a file cannot hold its own hash
    assert b'"report.pdf"' in (folder / "manifest.json").read_bytes()


def alternatives(pdf):
    """Return the alternative texts of all figures."""
    whole = everything(pdf)
    found = [
        bytes.fromhex(x.decode()).decode("utf-16") if x else ""
        for x in re.findall(rb"/Alt\s*<FEFF([0-9A-Fa-f]*)>", whole)
    ]
    return b"\n".join(re.findall(rb"/Alt\s*\((.*?)\)", whole, re.DOTALL)).decode(
        "latin-1"
    ) + "\n".join(found)


def test_every_panel_has_its_alternative_text(folder):
    texts = alternatives((folder / "report.pdf").read_bytes())
    wanted = [
        panel.label.words for result in fixture.results() for panel in make_case_panels(result)
    ]
    assert wanted
    assert all(words in texts for words in wanted)
    assert "within tolerance throughout" in texts


@pytest.mark.nightly
def test_chapters_of_the_data_report_are_there_when_wanted(tmp_path):
    more = {
        "title": "T-37",
        "provenance": fixture.PROVENANCE,
        "fits": fixture.fits(),
        "databases": fixture.databases(),
        "jobs": 1,
    }
    found = {}
    for chapters in ((), ("identification",), ("identification", "database")):
        for place in ("one", "two"):
            pom.write_report([fixture.roll_result()], tmp_path / place, chapters=chapters, **more)
        found[chapters] = (tmp_path / "one" / "report.pdf").read_bytes()
        assert (tmp_path / "two" / "report.pdf").read_bytes() == found[chapters]
    words = [alternatives(pdf) for pdf in found.values()]
    flown = [
        "Angle of attack and Mach number of",
        "CL of short period, 4 terms: measured",
        "CL of short period, 2 terms: measured",
    ]
    terms = compare_for_report(fixture.databases(), {}, run_line_classes(fixture.databases()))[
        "terms"
    ]
    tables = [figure.words for term in terms for figure in term["figures"]]
    assert tables
    for wanted, there in ((flown, (False, True, True)), (tables, (False, False, True))):
        assert [all(one in text for one in wanted) for text in words] == list(there)
        assert [any(one in text for one in wanted) for text in words] == list(there)
    with pytest.raises(UnknownName, match="unknown chapter 'gear'"):
        pom.write_report([fixture.roll_result()], tmp_path / "three", chapters=["gear"], **more)


def test_the_figure_of_a_fit_and_a_published_one_without_samples(tmp_path):
    (tmp_path / "values.csv").write_text(
        "model,coefficient,term,value,stderr,mach,alpha [deg]\nreport,CL,alpha,4.9,0.1,0.3,4\n"
    )
    (published,) = flighttest.combining.read_published(tmp_path / "values.csv")
    first, _, bare = identification_chapter([*fixture.fits(), published], {}, on_paper=True)["fits"]
    assert first["drawing"].words.startswith(
        "CL of short period, 4 terms: measured, fitted, residual with an rms of 0.00"
    )
    assert first["drawing"].body.count("trace run-3") == 1
    assert bare["drawing"] is None
    assert [row["name"] for row in bare["terms"]] == ["alpha"]


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("date", "printed"),
    [("2026-11-21", "2026-11-21T00:00:00+00:00"), ("", "1970-01-01T00:00:00+00:00")],
)
def test_the_date_is_that_of_the_results(date, printed):
    pdf = paper([fixture.roll_result()], provenance={"date": date})
    assert metadata(pdf, "xmp:CreateDate").replace("Z", "+00:00") == printed


def test_a_report_without_a_date_has_that_of_its_newest_input(tmp_path):
    places = {}
    for name, day in (("record.nc", "2024-03-01"), ("case.toml", "2025-07-09"), ("gone.nc", "")):
        places[name] = str(tmp_path / name)
        if day:
            (tmp_path / name).write_text(name)
            noon = datetime.datetime.fromisoformat(f"{day}T12:00:00+00:00").timestamp()
            os.utime(tmp_path / name, (noon, noon))
    newest = document.document_date({"date": "", "places": places})
    assert newest.isoformat() == "2025-07-09T00:00:00+00:00"
    # a stated date counts, whatever the files have
    stated = document.document_date({"date": "2026-11-21", "places": places})
    assert stated.isoformat() == "2026-11-21T00:00:00+00:00"


@pytest.mark.nightly
@pytest.mark.parametrize("form", ["a4", "letter"])
def test_paper_sizes(form):
    width = float(
        re.search(
            rb"/MediaBox\s*\[0 0 ([\d.]+)", everything(paper([fixture.roll_result()], form))
        ).group(1)
    )
    assert width / 72 * 25.4 == pytest.approx(PAPER_WIDTH[form], abs=0.1)


def test_more_than_seven_panels_go_on(tmp_path):
    result = fixture.short_period_result()
    again = {f"engine{n}.thrust": result.signals["theta"] for n in range(1, 9)}
    many = replace(result, signals=result.signals.assign(again))
    drawn = case_drawings.draw_case(tmp_path, 1, many, None, 800.0, 1000.0)["pages"]
    assert sum(map(len, drawn)) == len(make_case_panels(many))
    assert max(map(len, drawn)) == 7
    assert len(drawn) > 2


@pytest.mark.nightly
def test_where_tables_fill_the_page_panels_take_the_next(tmp_path):
    drawn = case_drawings.draw_case(
        tmp_path, 1, fixture.short_period_result(), None, 100.0, 1000.0
    )["pages"]
    assert drawn[0] == []
    assert sum(map(len, drawn)) == len(make_case_panels(fixture.short_period_result()))
    result = fixture.short_period_result()
    again = [
        result.verdict.assign(criterion=result.verdict["criterion"] + f" {n}", group=f"g{n}")
        for n in range(18)
    ]
    assert paper(
        [replace(result, verdict=pd.concat([result.verdict, *again], ignore_index=True))]
    ).startswith(b"%PDF")


@pytest.mark.nightly
@pytest.mark.parametrize(
    "words",
    ['"#[*_ $x$ \\ @a <b>` #panic() //', "短周期 🛩 \x07 \ud800 u\u0307\u0302", "עברית тест"],
)
def test_texts_stay_texts(words):
    result = fixture.roll_result()
    case = replace(
        result.case,
        title=words,
        objective=words,
        notes=words,
        rationale={"p": words},
        ticks={"roll_rate": words},
    )
    assert paper(
        [replace(result, case=case, failure=words)], title=words, revision=words
    ).startswith(b"%PDF")


def test_without_a_pdf_an_old_one_goes(folder, tmp_path):
    (tmp_path / "report.pdf").write_bytes((folder / "report.pdf").read_bytes())
    pom.write_report([fixture.roll_result()], tmp_path, title="x", paper=None)
    assert not (tmp_path / "report.pdf").exists()
    with pytest.raises(SchemaError, match="paper is 'a5'; give 'a4' or 'letter'"):
        pom.write_report([fixture.roll_result()], tmp_path, title="x", paper="a5")


def test_the_words_of_the_document_are_those_of_the_results():
    result = fixture.short_period_result()
    page = content.case_content(1, "key", result, fixture.PROVENANCE, None, mode_table(result))
    rows = {
        (block["criterion"].replace(" ", "_"), row["run"]): row
        for block in page["verdicts"]
        for row in block["rows"]
    }
    assert len(rows) == len(result.verdict)
    for row in result.verdict.to_dict("records"):
        mine = rows[row["criterion"], row["run"]]
        assert mine["state"] == row["verdict"]
        assert mine["ratio"] == f"{row['worst_ratio']:.2f}"
    assert [(o["run"], o["state"]) for o in page["outcomes"]] == [
        (run, result.status(run)) for run in result.runs
    ]
    assert "100 %" in page["kind"]
    assert [row[2] for row in page["digests"]] == [
        fixture.PROVENANCE["inputs"]["flight/t37_21_short_period.nc"],
        *(fixture.PROVENANCE["models"][run]["sha256"] for run in fixture.RUNS),
    ]


# ---- drawings ----


def drawn(result, index=0, height=60.0):
    styles = {**run_line_classes(result.runs), "applied": "run-0"}
    shown = make_case_panels(result)
    return figure.draw_case_panel(
        "x",
        result.signals["time"].values,
        shown[index],
        styles,
        result.case.events,
        height,
        True,
        True,
    ), shown[index]


def test_flight_lies_on_the_band_and_no_model_hides_it():
    item, _ = drawn(fixture.short_period_result())
    order = [
        element.get("class") for element in ElementTree.fromstring(item.svg).iter(f"{SVG}path")
    ]
    order = [
        name
        for name in order
        if name in ("band", "exit", "hair") or (name or "").startswith("trace")
    ]
    main = order[: order.index("hair") + 1]
    assert main == [
        "band",
        "exit",
        "trace run-0",
        "trace run-1",
        "trace run-2",
        "trace run-3",
        "hair",
    ]


def test_exits_are_hatched_where_they_are():
    item, panel = drawn(fixture.short_period_result())
    assert [run for run, found in panel.exits.items() if found] == ["datcom"]
    tree = ElementTree.fromstring(item.svg)
    assert len(tree.findall(f".//{SVG}path[@class='exit']")) >= 1
    assert len(tree.findall(f".//{SVG}line[@class='tickmark']")) == 1
    calm = fixture.short_period_result(poor=1.0)
    quiet = replace(
        calm,
        signals=calm.signals.where(calm.signals["run"] != "datcom", calm.signals.sel(run="flight")),
    )
    assert 'class="exit"' not in drawn(quiet)[0].svg


def test_lines_differ_without_colour():
    dashes = [dash for _, dash, _ in style.LINES.values()]
    assert len(set(dashes)) == len(dashes)
    assert [style.LINES[f"run-{i}"][1] == "" for i in range(4)] == [
        True,
        False,
        False,
        False,
    ]  # flight alone is solid


def luminance(colour):
    linear = [
        c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4
        for c in (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    ]
    return float(np.dot(linear, [0.2126, 0.7152, 0.0722]))  # WCAG 2.2, relative luminance


@pytest.mark.parametrize("colour", [colour for colour, _, _ in style.LINES.values()])
@pytest.mark.parametrize("ground", ["#ffffff", style.BAND])
def test_lines_stand_out_from_paper_and_band(colour, ground):
    a, b = sorted((luminance(colour), luminance(ground)))
    assert (b + 0.05) / (a + 0.05) >= 4.0


def test_no_text_is_below_seven_points():
    column = (PAPER_WIDTH["a4"] - 28.0) / 25.4 * 72 / 720  # points per unit of a drawing
    sizes = [
        float(size) * column
        for size in re.findall(r"font-size:([\d.]+)px", style.style_definitions())
    ]
    assert min(sizes) >= 7.0
    layout = (Path(document.__file__).parent / "report.typ").read_text(encoding="utf-8")
    assert min(float(size) for size in re.findall(r"size: ([\d.]+)pt", layout)) >= 7.0


def test_the_rest_of_a_record_does_not_squeeze_the_window():
    result = fixture.short_period_result()
    signals = result.signals.copy(deep=True)
    signals["theta"].loc[{"run": "flight", "time": signals["time"][:5]}] = (
        3.0  # before the window, as vanes at a standstill
    )
    item, panel = drawn(replace(result, signals=signals))
    assert panel.limits[1] > np.degrees(3.0)
    ticks = [
        float(t.text.replace("\N{MINUS SIGN}", "-"))
        for t in ElementTree.fromstring(item.svg).find(f"{SVG}g").iter(f"{SVG}text")
    ]
    assert max(ticks) < 40.0


@pytest.mark.nightly
@pytest.mark.parametrize("room", [500.0, 800.0, 1000.0])
def test_panels_fill_the_room_and_never_more(room):
    shown = make_case_panels(fixture.short_period_result())
    count, height = figure.arrange_panels(shown, room)
    assert 1 <= count <= 7
    total = sum(drawn(fixture.short_period_result(), i, height)[0].height for i in range(count))
    assert total - (count - 1) * (figure.FOOT - figure.GAP) <= room + 1.0


def shares():
    rows = [
        ("prior", "", 0.0, 0.0, 2.0),
        ("final", "", 1.0, 0.0, 0.4),
        ("share", "CD/gear", -0.1, 0.02, 2.16),
    ]
    rows += [("share", "Cm/qhat", 0.8, 0.05, 0.88), ("share", "others", 0.3, 0.0, 0.4)]
    return pd.DataFrame(rows, columns=["stage", "term", "explained", "stderr", "mismatch"])


@pytest.mark.nightly
def test_the_waterfall_falls_from_the_prior_to_the_final_model():
    item = draw_waterfall(shares())
    bars = [
        e
        for e in ElementTree.fromstring(item.svg).iter(f"{SVG}rect")
        if e.get("class") in ("bar", "rise", "total")
    ]
    assert [bar.get("class") for bar in bars] == ["total", "rise", "bar", "bar", "total"]
    ends = [(float(bar.get("x")), float(bar.get("x")) + float(bar.get("width"))) for bar in bars]
    assert ends[0][1] == pytest.approx(
        ends[1][0], abs=0.2
    )  # the first share starts at the mismatch of the prior
    assert ends[1][1] == pytest.approx(ends[2][1], abs=0.2)
    assert ends[2][0] == pytest.approx(ends[3][1], abs=0.2)
    assert ends[3][0] == pytest.approx(
        ends[4][1], abs=0.2
    )  # and the last ends at that of the final model
    assert "Cm/qhat  (pitching-moment increment due to pitch rate): explains 80 ± 5 %" in item.words
    assert draw_waterfall(shares().iloc[:2]) is None
    assert paper(
        [fixture.short_period_result()], diagnoses={"short_period_full_flaps": fixture.diagnosis()}
    ).startswith(b"%PDF")


def test_legend_samples_do_not_overlap():
    tree = ElementTree.fromstring(
        figure.draw_legend(
            run_line_classes(["datcom", "corrected", "final", "a model with a rather long name"])
        ).svg
    )
    places = [
        tuple(map(float, re.findall(r"[\d.]+", group.get("transform"))))
        for group in tree.findall(f"{SVG}g")
    ]
    assert all(abs(a[0] - b[0]) > 30.0 or a[1] != b[1] for a, b in combinations(places, 2))
    assert all(x < 720.0 for x, _ in places)


def test_a_cross_plot_turns_back_with_its_band():
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    x = {run: 10.0 * np.sin(turn) for run in ("flight", "final")}  # a sweep there and back
    y = {
        "flight": 100.0 * np.sin(turn) + 20.0 * np.cos(turn),
        "final": 104.0 * np.sin(turn) + 18.0 * np.cos(turn),
    }
    plot = Cross(
        ("force",), quantity_label("column"), quantity_label("F_column"), x, y, np.full(200, 12.0)
    )
    rows = [{"run": "final", "criterion": "force", "verdict": "pass", "worst_ratio": 0.42}]
    item = cross_drawing("x", plot, {"flight": "run-0", "final": "run-3"}, rows)
    paths = {
        e.get("class"): e.get("d") for e in ElementTree.fromstring(item.svg).iter(f"{SVG}path")
    }
    assert list(paths)[-4:] == ["band", "trace run-0", "trace run-3", "hair"]
    places = np.array(
        [[float(v) for v in pair.split(",")] for pair in paths["trace run-0"][1:].split()]
    )
    assert np.diff(places[:, 0]).min() < 0.0 < np.diff(places[:, 0]).max()
    assert places[:, 0].min() > style.LEFT
    assert "final: force pass, 0.42 of the tolerance" in item.words


@pytest.mark.nightly
def test_a_word_that_no_line_holds_is_broken(monkeypatch):
    """Typeset as pictures of 20 dots an inch: nothing is printed in the last 5 mm of any page."""
    import typst
    from matplotlib.pyplot import imread

    word, result = "x" * 400, fixture.roll_result()
    result = replace(result, case=replace(result.case, title=word, objective=word, notes=word))
    monkeypatch.setattr(
        document,
        "_typeset",
        lambda folder, _: typst.compile(
            str(folder / "report.typ"), root=str(folder), format="png", ppi=20
        ),
    )
    for page in paper([result], title=word):
        assert imread(io.BytesIO(page))[:, -4:, :3].min() == 1.0


def test_the_title_of_a_drawing_holds_no_combining_mark():
    """typst refuses a dot over a Greek letter in a drawing, and with it the whole report."""
    for name in VOCABULARY:
        for text, _ in style.title_pieces(quantity_label(name)):
            assert not any(map(unicodedata.combining, text)), name
