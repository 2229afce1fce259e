"""`flight report` on the real flights of the Citation II: every figure inside the bounds of the
data set's README, from the command line.

The plans with the bounds and their sources: ``maps/evaluate_*.toml``.
"""

import json

import pytest
from click.testing import CliRunner

from flighttest.cli.group import flight

BOUNDS = {2018: 25, 2019: 14, 2020: 20}


def report(*words):
    return CliRunner().invoke(flight, ["report", *map(str, words)], catch_exceptions=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    "year", [2019, *(pytest.param(year, marks=pytest.mark.nightly) for year in (2018, 2020))]
)
def test_every_figure_is_inside_its_bounds(citation, year, tmp_path):
    page = tmp_path / "page.html"
    done = report(citation.HERE / "maps" / f"evaluate_{year}.toml", "-o", page, "--json")
    found = json.loads(done.stdout)
    assert found["refused"] == {}
    assert [
        (row["of"], row["value"]) for row in found["bounds"] if row["verdict"] != "inside"
    ] == []
    assert found["verdict"] == f"{BOUNDS[year]} of {BOUNDS[year]} figures inside their bounds"
    assert done.exit_code == 0
    text = page.read_text()
    assert found["verdict"] in text
    assert len(text) < 400_000
    figures = {name: figure["value"] for name, figure in found["figures"].items()}
    # the damper's rudder is recorded, and as an input it leaves the Dutch roll of the airframe
    assert figures["dutch_roll_damped.period"] == pytest.approx(
        figures["dutch_roll.period"], rel=0.03
    )
    assert figures["dutch_roll_damped.damping_ratio"] == pytest.approx(
        figures["dutch_roll.damping_ratio"], abs=0.015
    )
    # published Cl_p -0.7109 and Ixx of 6000 kg give 0.24 to 0.29 s at these heights and speeds
    assert 0.15 < figures["roll.time_constant"] < 0.4


@pytest.mark.slow
def test_signs_of_the_recorder_stop_the_evaluation(citation, tmp_path):
    """2019 as recorded: both lateral surfaces have the other sign; no derivative and no mode is
    given.
    """
    text = (citation.HERE / "maps" / "evaluate_2019.toml").read_text()
    for name in ("citation_2019.toml", "citation.toml"):
        (tmp_path / name).write_text(
            (citation.HERE / "maps" / name).read_text().replace("sign = -1", "sign = 1")
        )
    (tmp_path / "plan.toml").write_text(
        text.replace("../../../../shared", str((citation.FLIGHTS / "../../..").resolve()))
    )
    done = report(tmp_path / "plan.toml", "--json")
    found = json.loads(done.stdout)
    assert done.exit_code == 1
    assert found["verdict"].startswith("not evaluated: the record is not fit for it")
    errors = {
        finding["name"]
        for finding in found["quality"]["findings"]
        if finding["severity"] == "error"
    }
    assert errors == {"sign:delta_a+p", "sign:delta_r+r"}
    assert "dutch_roll.period" not in found["figures"]
