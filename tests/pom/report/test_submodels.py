"""The chapter on submodels: every estimate with its standard error, on page and paper, and what the
corrected model took.
"""

import contextlib
import re
import sys
import zlib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import pom
from flightmech.errors import SchemaError
from flightmech.terms import make_term
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.remarks import Convergence, Remark
from flighttest.submodels.control_loading.identification import identify_control_loading
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.simulation import SimulatedWindow
from flighttest.submodels.engine.result import identify_engine
from flighttest.submodels.ground_effect.identification import identify_ground_effect
from flighttest.submodels.landing_gear.result import GearConstant
from pom.diagnosis.term_swaps import by_submodel
from pom.report.pdf import content, style
from pom.report.submodels.engine import _draw_responses, _draw_tables
from pom.report.submodels.landing_gear import landing_gear
from pom.report.submodels.sections import (
    make_sections,
    needed_submodels,
    submodels_context,
)

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture

STEP = 0.05


def over_ground(h, seed):
    """Lift at one height, in free air at zero."""
    g = np.random.default_rng(seed)
    time = np.arange(0.0, 20.0, STEP)
    alpha = 0.08 + 0.03 * np.sin(0.9 * time + seed)
    CL = (
        0.4 * (1.0 + (0.45 * h**-1.2 if h else 0.0))
        + 5.0 * alpha
        + 1e-3 * g.standard_normal(time.size)
    )
    columns = {"alpha": alpha, "CL": CL} | ({"h_agl": np.full(time.size, h)} if h else {})
    return xr.Dataset({name: ("time", x) for name, x in columns.items()}, {"time": time})


def swept(qbar):
    """A slow sweep of the column at one speed."""
    time = np.arange(0.0, 30.0, STEP)
    travel = 0.08 * np.sin(0.4 * time)
    force = 4.0 + 10.0 * np.sign(np.cos(0.4 * time)) + 0.6 * qbar * (0.005 + 0.7 * travel)
    columns = {
        "column": travel,
        "F_column": force,
        "delta_e": -2.0 * travel,
        "qbar": np.full(time.size, qbar),
    }
    return xr.Dataset({name: ("time", x) for name, x in columns.items()}, {"time": time})


@pytest.fixture(scope="module")
def results():
    """One result of each kind."""
    ground = identify_ground_effect(
        [RegressionModel.parse("CL = 1 + alpha")],
        [over_ground(h, k) for k, h in enumerate((1.5, 2.0, 3.0, 6.0, 0.0))],
        {"CL": ["1"]},
    )
    loading = ControlLoading("column", -2.0, 1.0, 0.3, "Ch_e = 1 + delta_e", ("offset", "friction"))
    column = identify_control_loading(loading, [swept(q) for q in (1500.0, 6000.0)], order=2)
    prior = make_term(
        np.outer([2e3, 5e3, 9e3], [1.0, 0.9]), {"corrected_n2": [0.6, 0.8, 1.0], "mach": [0.0, 0.4]}
    )
    speeds = np.array([0.62, 0.7, 0.78, 0.86, 0.94, 0.98])
    points = {
        "n2": speeds,
        "mach": np.full(6, 0.1),
        "h": np.zeros(6),
        "thrust": 1.1 * 0.97 * np.interp(speeds, [0.6, 0.8, 1.0], [2e3, 5e3, 9e3]),
    }
    engine = identify_engine(
        recorded=xr.Dataset({k: ("point", v) for k, v in points.items()}),
        prior={"corrected_thrust": prior},
    )
    return {"engine": engine, "column": column, "ground effect": ground}


def flown():
    time = np.linspace(0.0, 1.0, 21)
    travel = np.stack([0.02 * np.exp(-time), 0.021 * np.exp(-time)], axis=1)
    return SimulatedWindow(time, travel, -2.0 * travel)


def test_every_estimate_stands_with_its_standard_error(results):
    engine, column, ground = make_sections(results, {"column": [flown()]})
    assert [row[0] for row in engine.grids[0].rows] == ["0.6000", "0.8000", "1.000"]
    assert {row[0] for row in column.grids[0].rows} == {"offset", "friction"}
    assert {row[0] for row in column.grids[1].rows} == {"Ch_e: 1", "Ch_e: delta_e"}
    (row,) = ground.grids[0].rows
    k, s = results["ground effect"]["CL"].row("1").k, results["ground effect"]["CL"].row("1").s
    assert (row[0], float(row[3]), float(row[5].replace("\N{MINUS SIGN}", "-"))) == (
        "CL: 1",
        pytest.approx(k, rel=1e-3),
        pytest.approx(s, rel=1e-3),
    )
    assert sum(", taken" in row[0] for row in ground.grids[1].rows) == 1
    assert column.techniques[-1][:2] == ("free motion, simulated", "check, not fitted")
    assert all(
        picture.words and picture.body
        for section in (engine, column, ground)
        for picture in section.pictures
    )
    assert [section.pictures[0].words.split(",")[0] for section in (engine, column, ground)] == [
        "Corrected net thrust over corrected speed",
        "Free motion of the column",
        "Factor K over the height of CL: 1",
    ]


def test_the_largest_free_motion_is_drawn():
    """Of many windows those with the largest travel."""
    small = SimulatedWindow(flown().time, 0.1 * flown().travel, flown().deflection)
    from pom.report.submodels.control_loading import MOST, _draw_free_motion

    (picture,) = _draw_free_motion("column", "column", [small] * 3 + [flown()] * MOST)
    (only,) = _draw_free_motion("column", "column", [flown()] * MOST)
    assert picture.body == only.body


def test_the_force_is_drawn_over_the_travel_at_every_speed(results):
    """As [LR743] Fig. 10: both branches of the friction loop, recorded and by the constants, near
    speeds in one panel.
    """
    (section,) = make_sections(
        {"column": results["column"]}, {}, {"column": [swept(1500.0), swept(6000.0), swept(1510.0)]}
    )
    (force,) = section.pictures
    assert (
        force.words
        == "Force at the column over its travel while it slides, recorded and by the identified "
        "constants, at 2 speeds"
    )
    assert [
        text in force.body for text in ("dynamic pressure 1.5 kPa", "dynamic pressure 6.0 kPa")
    ] == [True, True]
    assert force.body.count('class="node run-0"') == force.body.count('class="node run-3"') > 0
    with pytest.raises(SchemaError, match="driven_motion: 'wheel' is not a submodel"):
        make_sections({}, {}, {"wheel": []})


def test_the_response_of_the_spools_is_drawn(results):
    """As [LR743] Fig. 11: the power changes of the largest change of speed."""
    time = np.arange(0.0, 10.0, 0.5)

    def change(size):
        n2 = 0.6 + size * (1.0 - np.exp(-time))
        columns = {
            "throttle": time > 1.0,
            "n2": n2,
            "n2_model": n2 + 0.001,
            "n1": n2 - 0.1,
            "n1_model": n2 - 0.1,
        }
        return xr.Dataset(
            {k: ("time", v.astype(float)) for k, v in columns.items()},
            {"time": time},
            {"record": f"change of {size}"},
        )

    (picture,) = _draw_responses("engine", [change(size) for size in (0.1, 0.4, 0.2, 0.3, 0.35)])
    assert (
        picture.words
        == "Response of the spools to the lever, recorded and simulated, 4 of 5 power changes"
    )
    assert picture.body.index("change of 0.4") < picture.body.index("change of 0.2")
    assert "change of 0.1" not in picture.body
    assert picture.body.count('class="trace run-3"') == 4 * 2 + 1  # both spools, and the key


def test_tables_over_a_flight_condition_have_a_line_for_every_node():
    limit = make_term(
        np.outer([1.0, 2.0, 3.0], [1.0, 0.9]),
        {"n2": [0.6, 0.8, 1.0], "h": [0.0, 6000.0]},
        stderr=0.01,
    )
    command = make_term([0.5, 1.0], {"throttle": [0.0, 1.0]}, stderr=0.01)
    (picture,) = _draw_tables(
        "engine",
        {"n2_up_limit": SimpleNamespace(leaf=limit), "n2_command": SimpleNamespace(leaf=command)},
    )
    assert picture.words == "n2 up limit, n2 at rest, 1, with one standard error"
    assert "h 6000" in picture.body
    assert picture.body.count('class="trace run-') == 2 + 2 + 1  # key, both heights, the schedule


def test_every_wheel_has_its_loads():
    wheels = ("nose", "left", "right")
    s = np.linspace(0.05, 0.12, 40)
    outputs = ["load.nose", "load.left", "load.right", "Fx"]
    force = xr.DataArray(
        np.stack([48e3 * s, 95e3 * s, 95e3 * s, -10.0 * s], axis=1),
        {"output": outputs},
        ("time", "output"),
    )
    compression = xr.DataArray(
        np.stack([s] * 3, axis=1), {"wheel": list(wheels)}, ("time", "wheel")
    )
    noise = xr.Dataset(
        {"stderr": (("manoeuvre", "output"), np.full((1, 4), 70.0))}, {"output": outputs}
    )
    loads = SimpleNamespace(
        fit=SimpleNamespace(noise=noise),
        loads=[xr.Dataset({"force": force, "compression": compression})],
    )
    constants = {"gear.left,right.stiffness": GearConstant(95e3, 480.0, "wheel loads")}
    groups = (SimpleNamespace(names=("nose",)), SimpleNamespace(names=("left", "right")))
    found = SimpleNamespace(
        groups=groups,
        constants=constants,
        undetermined={"runway.mu_dry": "no wheel came near it"},
        loads=loads,
        flown=None,
        remarks=[Remark("convergence", "wheel loads: not converged after 40 iterations")],
    )
    section = landing_gear("landing gear", found)
    assert section.grids[0].rows == (("gear.left,right.stiffness", "95000", "480", "wheel loads"),)
    assert section.remarks == (
        "runway.mu_dry not determined: no wheel came near it",
        "wheel loads: not converged after 40 iterations",
    )
    assert section.pictures[0].words == "Reconstructed load over compression of nose, left, right"
    assert section.pictures[0].body.count("h0") == 3 * len(s)  # a mark for every sample
    classes = {
        css
        for group in re.findall(r'class="([^"]*)"', section.pictures[0].body)
        for css in group.split()
    }
    assert all(
        f".{css}{{" in style.style_definitions() or f".{css}," in style.style_definitions()
        for css in classes
    )  # drawn on paper too


def test_a_search_that_did_not_converge_is_in_its_section(results):
    stopped = Convergence(False, 5, 7.0)
    column = replace(results["column"], iterations={"weights of the force": stopped})
    static = replace(results["engine"].static, convergence=stopped)
    engine = replace(results["engine"], static=static)
    sections = make_sections({"engine": engine, "column": column}, {})
    for section in sections:
        assert any("not converged after 5 iterations" in text for text in section.remarks)
    assert not any("converged" in text for text in make_sections(results, {})[0].remarks)


def test_what_is_no_submodel_is_refused(results):
    with pytest.raises(SchemaError) as caught:
        make_sections({"gear": 3.0}, {"wheel": []})
    assert caught.value.problems[0] == "free_motion: 'wheel' is not a submodel; there are: gear"
    assert caught.value.problems[1].startswith("submodels.gear: float; give ")
    assert make_sections({}, {}) == []


def test_terms_and_parts_belong_to_submodels():
    database = xr.DataTree.from_dict(
        {
            "/CL/basic": make_term(0.3),
            "/CL/ground": make_term([0.1, 0.0], {"h_agl": [1.0, 9.0]}),
            "/Ch_e/alpha": make_term(-0.1, regressors=["alpha"]),
        }
    )
    names = ["gear/nose", "Ch_e/alpha", "CL/ground", "CL/basic", "circuit/column", "engine/static"]
    assert by_submodel(names, database) == {
        "aerodynamics": ["CL/basic"],
        "ground effect": ["CL/ground"],
        "engine": ["engine/static"],
        "landing gear": ["gear/nose"],
        "control loading": ["Ch_e/alpha", "circuit/column"],
    }


def test_what_the_corrected_model_takes():
    rows = [
        ("single", "CL/basic", 0.2),
        ("single", "engine/static", 0.7),
        ("sequence", "engine/static", 0.7),
        ("sequence", "CL/basic", 0.9),
    ]
    table = pd.DataFrame(rows, columns=["stage", "term", "explained"])
    database = xr.DataTree.from_dict({"/CL/basic": make_term(0.3)})
    grid = needed_submodels({"chop": table}, {"final": database})
    assert [row[:2] for row in grid.rows] == [
        ("aerodynamics", "CL/basic"),
        ("engine", "engine/static"),
    ]
    assert grid.rows[1][2] == "needed by chop (alone 70 % of the gap)"
    assert needed_submodels({}, {"final": database}) is None


@pytest.mark.nightly
def test_page_and_paper_hold_the_same(results, tmp_path):
    chapter = make_sections(results, {})
    page = submodels_context(chapter)
    assert [item["key"] for item in page] == ["engine", "column", "ground-effect"]
    assert [item["grids"] for item in page] == [section.grids for section in chapter]
    paper = [content.submodel_content(section) for section in chapter]
    assert [[grid["rows"] for grid in item["grids"]] for item in paper] == [
        [grid.rows for grid in item["grids"]] for item in page
    ]
    report = pom.write_report(
        [fixture.roll_result()],
        tmp_path,
        title="T-37",
        submodels=results,
        free_motion={"column": [flown()]},
    )
    assert 'href="#submodels"' in report.read_text(encoding="utf-8")
    whole = (tmp_path / "report.pdf").read_bytes()
    texts = {
        bytes.fromhex(x.decode()).decode("utf-16")
        for x in re.findall(rb"/Alt\s*<FEFF([0-9A-Fa-f]*)>", inflated(whole))
    }
    texts |= {
        x.decode("latin-1") for x in re.findall(rb"/Alt\s*\((.*?)\)", inflated(whole), re.DOTALL)
    }
    assert {picture.words for section in chapter for picture in section.pictures} <= texts


def inflated(pdf):
    """A PDF with its deflated streams unpacked."""
    parts = [pdf]
    for found in re.finditer(rb"stream\r?\n(.*?)\nendstream", pdf, re.DOTALL):
        with contextlib.suppress(zlib.error):
            parts.append(zlib.decompressobj().decompress(found.group(1)))
    return b"\n".join(parts)
