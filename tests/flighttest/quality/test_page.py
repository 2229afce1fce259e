"""Text, JSON and page of a data-quality check, and its command."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import flightmech
import flighttest
from flightmech.errors import SchemaError
from flighttest.cli.group import flight
from flighttest.reconstruction.quality.page import draw_time_chart, write_page

T37 = Path(__file__).parents[3] / "data" / "t37"
RECORD = T37 / "flight" / "t37_22_val_roll_response_clean.nc"


class PageReader(HTMLParser):
    """Collects tags and text of a page and checks that tags close."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.words, self.open = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "link", "br"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


@pytest.fixture(scope="module")
def wrong_names(tmp_path_factory):
    file = tmp_path_factory.mktemp("names") / "names.toml"
    text = (T37 / "names.toml").read_text()
    file.write_text(text.replace('theta = "theta"', 'theta = { column = "theta", sign = -1 }'))
    return file


@pytest.fixture(scope="module")
def quality(wrong_names):
    return flighttest.assess(
        flighttest.read(RECORD, wrong_names), flightmech.read_aircraft(T37 / "aircraft.toml")
    )


def call(*arguments):
    return CliRunner().invoke(flight, ["check", *map(str, arguments)], catch_exceptions=False)


@pytest.mark.slow
def test_finding_states_what_to_write_into_the_name_map(quality):
    fault = quality.findings[0]
    assert fault.name == "sign:theta"
    assert fault.remedy == 'theta = "theta"   # in [imu] of the name map'


@pytest.mark.slow
def test_report_reads_in_order(quality):
    text = quality.report()
    assert text.splitlines()[1] == "not fit for identification as read: 1 error, 0 warnings, 1 note"
    assert (
        text.index("error")
        < text.index("note")
        < text.index("kinematic consistency")
        < text.index("delays")
        < text.index("answers")
    )


@pytest.mark.slow
def test_page_is_whole_and_needs_nothing_else(quality, tmp_path):
    write_page(quality, tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    page = PageReader(text)
    assert page.open == []
    assert "http://" not in text.replace("http://www.w3.org", "")
    assert not [tag for tag, attrs in page.tags if tag == "script" or "src" in attrs]
    words = " ".join(page.words)
    assert "theta has the wrong sign" in words
    assert sum(tag == "svg" for tag, _ in page.tags) > 20
    ids = {attrs["id"] for _, attrs in page.tags if "id" in attrs}
    assert {attrs["href"][1:] for tag, attrs in page.tags if tag == "a"} <= ids
    assert list(tmp_path.iterdir()) == [tmp_path / "page.html"]


def test_page_escapes_text_of_files(quality):
    from dataclasses import replace

    from flighttest.reconstruction.quality.page import render_quality_page

    text = render_quality_page(
        replace(quality, facts={**quality.facts, "title": "<script>alert(1)</script>"})
    )
    assert "<script>" not in text


def test_json_holds_findings_and_figures(quality):
    found = json.loads(quality.to_json())
    assert found["findings"][0]["name"] == "sign:theta"
    assert found["verdict"].startswith("not fit")
    assert {row["channel"] for row in found["channels"]} >= {"p", "V", "delta_e"}
    assert {row["relation"] for row in found["kinematics"]} >= {"phi_rate", "force_z"}


@pytest.mark.nightly
def test_command_of_a_wrong_record(wrong_names, tmp_path):
    done = call(RECORD, "--names", wrong_names, "-o", tmp_path / "q.html", "--json")
    assert done.exit_code == 1
    assert json.loads(done.output)["findings"][0]["name"] == "sign:theta"
    assert (tmp_path / "q.html").stat().st_size > 50_000


@pytest.mark.nightly
def test_command_of_a_sound_record():
    done = call(RECORD, "--names", T37 / "names.toml", "--aircraft", T37 / "aircraft.toml")
    assert done.exit_code == 0
    assert "sound: 0 errors, 0 warnings" in done.output


def test_record_without_motion(tmp_path):
    file = tmp_path / "r.csv"
    file.write_text("time [s],mass [kg]\n" + "".join(f"{i},{2000 - i}\n" for i in range(20)))
    with pytest.raises(SchemaError, match="a quality check needs channels of motion"):
        flighttest.assess(flighttest.read(file))


def test_chart_keeps_every_peak():
    time = np.arange(0.0, 5000.0, 0.02)
    line = np.zeros_like(time)
    line[123_457] = 5.0
    svg = draw_time_chart(time, [line], "deg")
    (data,) = re.findall(r'<path class="one" d="([^"]+)"', svg)
    numbers = [float(x) for x in re.findall(r"-?\d*\.?\d+", data.replace("l", " "))]
    heights = np.cumsum(numbers[1::2])
    assert heights.min() == pytest.approx(
        22.0 + 126.0 * 0.05 / 1.1, abs=0.06
    )  # below the head by the margin of a twentieth; tenths
    assert len(heights) < 10
