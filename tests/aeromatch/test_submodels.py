"""Submodels in the main job: a control and a ground effect of known constants, found through the
sections of a project.
"""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import aerodb
from aeromatch.planning.model_checks import station_problems
from aeromatch.project.project import read_project
from aeromatch.project.sections import (
    Controls,
    ControlSection,
    EngineSection,
    GroundEffectSection,
    RecordSelection,
    StallSection,
    repeated_records,
)
from aeromatch.workbench.fit_request import validate_request
from aeromatch.workflow import submodels
from aeromatch.workflow.windows import raise_problems, spans_of
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.controls import Circuit
from flightmech.aircraft.controls import ControlGeometry as Surface
from flightmech.aircraft.engine import Engine as Jet
from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.aircraft.separation import NEEDED, FlowSeparation
from flightmech.errors import SchemaError
from flightmech.terms import make_term

COMMUTER = Path(__file__).parents[2] / "data" / "commuter"
K, S = 0.45, -1.2  # of CL0 over the ground, h in metres
GEARING, AREA, CHORD = -2.0, 1.0, 0.3
FRICTION, HINGE = 10.0, {"1": 0.005, "alpha": -0.1, "delta_e": -0.35}
STEP = 0.02
CRAFT = Aircraft("toy", 20.0, 2.0, 10.0, 2000.0, 1e4, 1e4, 2e4)


def test_windows_of_whole_records_and_of_manoeuvres():
    table = pd.DataFrame(
        {
            "manoeuvre": ["sweep", "release"],
            "control": ["column", "column"],
            "start": [0.0, 8.0],
            "end": [8.0, 12.0],
        }
    )
    problems: list[str] = []
    flown = [
        RecordSelection(records=("a", "b")),
        RecordSelection(records=("a",), manoeuvres=("release column", "puls")),
    ]
    found = spans_of("controls.column.free", flown, {"a": table, "b": table}, problems)
    assert found == {"a": [(-np.inf, np.inf), (8.0, 12.0)], "b": [(-np.inf, np.inf)]}
    assert problems[0].startswith("controls.column.free, record a: unknown manoeuvre 'puls'")
    assert problems[1:] == [
        "controls.column.free, record a: 8 ... 12 s is taken twice; take it once"
    ]


@pytest.mark.parametrize(
    ("taken", "left"),
    [
        ([], [(0.0, 10.0)]),
        ([(2.0, 3.0), (9.0, 12.0)], [(0.0, 2.0), (3.0, 9.0)]),
        ([(-1.0, 11.0)], []),
        ([(20.0, 21.0)], [(0.0, 10.0)]),
    ],
)
def test_spans_without_others(taken, left):
    assert submodels._subtract_spans([(0.0, 10.0)], taken) == left


def swept(qbar, alpha):
    """A slow sweep of the column at one speed: the force of both equations of motion without
    masses.
    """
    time = np.arange(0.0, 30.0, STEP)
    travel = 0.08 * np.sin(2.0 * np.pi * time / 15.0)
    delta_e, direction = GEARING * travel, np.sign(np.cos(2.0 * np.pi * time / 15.0))
    hinge = HINGE["1"] + HINGE["alpha"] * alpha + HINGE["delta_e"] * delta_e
    force = 4.0 + FRICTION * direction - GEARING * qbar * AREA * CHORD * hinge
    columns = {
        "column": travel,
        "F_column": force,
        "delta_e": delta_e,
        "qbar": qbar,
        "alpha": alpha,
        "nz": 1.0,
        "wow_nose": 0.0,
    }
    return xr.Dataset(
        {name: ("time", np.broadcast_to(x, time.shape)) for name, x in columns.items()},
        {"time": time},
    )


def test_control_loading_through_its_section():
    records = {"slow": (1500.0, 0.10), "fast": (6000.0, 0.02), "faster": (9000.0, 0.01)}
    paths = {name: SimpleNamespace(states=swept(*at)) for name, at in records.items()}
    asked = ControlSection(
        driven=(RecordSelection(records=tuple(records)),),
        model="Ch_e = 1 + alpha + delta_e",
        constants=("offset", "friction"),
        order=2,
    )
    craft = replace(
        CRAFT,
        controls={"delta_e": Surface(AREA, CHORD, GEARING)},
        circuits={"column": Circuit((-0.1, 0.1), mass=3.0)},
    )
    spans = {"controls.column.driven": {name: [(-np.inf, np.inf)] for name in records}}
    found, motion, driven = submodels.identified_controls(
        SimpleNamespace(controls=Controls(column=asked)), craft, paths, spans
    )
    assert found["column"].value("friction")[0] == pytest.approx(FRICTION, rel=1e-3)
    for term, value in HINGE.items():
        assert found["column"].value(f"Ch_e: {term}")[0] == pytest.approx(value, rel=0.02)
    assert motion == {"column": []}
    assert [part.sizes["time"] for part in driven["column"]] == [
        path.states.sizes["time"] for path in paths.values()
    ]
    after = found["column"].aircraft(craft)
    assert after.circuits["column"].friction == pytest.approx(FRICTION, rel=1e-3)
    assert after.circuits["column"].mass == 3.0  # what was not identified stays


def flight(h, seed):
    """Lift over the ground at one height, or in free air, with white noise of 0.1 % of a lift
    coefficient.
    """
    g = np.random.default_rng(seed)
    time = np.arange(0.0, 20.0, 0.05)
    alpha = 0.08 + 0.03 * np.sin(2.0 * np.pi * time / 7.0 + seed)
    CL = 0.4 * (1.0 + (K * h**S if h else 0.0)) + 5.0 * alpha + 1e-3 * g.standard_normal(time.size)
    columns = {"alpha": alpha, "CL": CL, "delta_f": np.full(time.size, 0.7)}
    columns |= {"h_agl": np.full(time.size, h)} if h else {}
    return xr.Dataset(
        {name: ("time", x) for name, x in columns.items()},
        {"time": time},
        {"force_axes": "stability"},
    )


@pytest.mark.slow
def test_ground_effect_through_its_section_next_to_the_database():
    data = {f"at {h}": flight(h, k) for k, h in enumerate((1.5, 2.0, 3.0, 5.0, 9.0, 0.0))}
    database = xr.DataTree.from_dict(
        {
            "/CL/basic": make_term([0.4, 0.9], {"alpha": [0.0, 0.1]}),
            "/CL/ground": make_term([0.05, 0.0], {"h_agl": [1.0, 20.0]}),
        }
    )
    database.attrs = {"force_axes": "stability"}
    asked = GroundEffectSection(
        flown=(RecordSelection(records=tuple(data)),),
        models=("CL = 1 + alpha",),
        ground=("CL = 1",),
    )
    spans = {"ground_effect.flown": {name: [(-np.inf, np.inf)] for name in data}}
    found = submodels.identified_ground_effect(
        SimpleNamespace(ground_effect=asked), data, spans, database
    )
    row = found["CL"].row("1")
    assert (row.k, row.s) == (
        pytest.approx(K, abs=4.0 * row.k_stderr),
        pytest.approx(S, abs=4.0 * row.s_stderr),
    )
    assert found["CL"].form.startswith("k h^s")
    assert (
        found["CL"].evidence.loc["database", "rms"]
        > 2.0 * found["CL"].evidence.loc[found["CL"].form, "rms"]
    )


STALL = StallSection(
    flown=(RecordSelection(records=("a", "b")),),
    attached_to="10 deg",
    coefficients=("CL", "Cm"),
    attached=("CL = 1 + alpha",),
)


def test_a_stall_through_its_section(monkeypatch):
    """The attached flow goes on as a line to 10 deg beyond the records."""
    alpha = np.radians([0.0, 5.0, 10.0])
    leaf = make_term([0.2, 0.6, 1.0], {"alpha": alpha})
    root = {"S": 20.0, "cbar": 2.0, "b": 10.0, "x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0}
    database = aerodb.make_database(
        {"CL/basic": leaf}, title="t", aircraft="a", force_axes="stability", **root
    )
    time = np.linspace(0.0, 1.0, 5)
    flown = xr.Dataset({"alpha": ("time", np.radians(15.0) * time)}, {"time": time})
    asked = {}
    monkeypatch.setattr(
        submodels, "identify_stall", lambda *given, **named: asked.update(named, given=given)
    )
    spans = {"stall.flown": {"a": [(-np.inf, np.inf)], "b": [(0.0, 0.5)]}}
    submodels.identified_stall(
        SimpleNamespace(stall=STALL), CRAFT, {"a": flown, "b": flown}, spans, database
    )
    parts, station, cbar = asked["given"]
    assert [part.sizes["time"] for part in parts] == [5, 3]
    assert (station, cbar) == (2.5, 2.0)
    assert (asked["axis"], asked["coefficients"]) == ("", ("CL", "Cm"))
    assert asked["attached"] == {"CL": ("1", "alpha")}
    line = asked["database"]["CL/basic"]
    assert np.rad2deg(line["alpha"].values) == pytest.approx([0, 5, 10, 25])
    assert line["value"].values[-1] == pytest.approx(1.0 + 0.4 * 3.0)


def test_a_stall_section_states_its_faults():
    def problems(**changes):
        return list(StallSection(**{**dict(STALL), **changes}).problems())

    assert problems() == []
    assert "CL is missing" in problems(coefficients=("Cm",))[0]
    assert "coefficient of a stall" in problems(coefficients=("CL", "CX"))[0]
    assert problems(attached_to="12 kg")[0].startswith("stall.attached_to: ")
    for angle in ("-80 deg", "300 deg", "1e999 deg"):
        assert problems(attached_to=angle)[0].startswith(f"stall.attached_to: found '{angle}'")
    assert problems(station="-2 m")[0].startswith("stall.station: found -2 m; give a distance")
    assert "occurs twice" in problems(coefficients=("CL", "CL"))[0]
    assert problems(attached=("CL : alpha",))[0].startswith("stall.attached: ")


def test_a_station_beyond_the_wing_tip_is_stated_before_the_run():
    for station, count in (("8 m", 1), ("8 ft", 0), ("", 0)):
        project = SimpleNamespace(stall=StallSection(**{**dict(STALL), "station": station}))
        found = list(station_problems(project, CRAFT))
        assert len(found) == count
        assert all("stall.station: found 8 m, beyond the wing tip at 5 m" in text for text in found)


def test_a_record_is_taken_once():
    """Records that occur twice would make standard errors too small."""
    whole, cut = RecordSelection(records=("a", "b")), RecordSelection(records=("a",), window=[0, 1])
    assert list(repeated_records({"stall.flown": (whole, cut)})) == []
    twice = {"stall.flown": (whole, RecordSelection(records=("b",)))}
    assert list(repeated_records(twice)) == ["stall.flown: record 'b' is taken twice; take it once"]


@pytest.mark.parametrize(
    ("selections", "found"),
    [
        ([{"manoeuvres": ["3211", "3211 elevator"]}], ["4 ... 12 s is taken twice; take it once"]),
        ([{"window": [0, 60]}, {}], ["0 ... 60 s is taken twice; take it once"]),
        ([{}, {}], ["the whole record is taken twice; take it once"]),
        ([{"window": [[0, 10], [4, 30]]}], ["4 ... 10 s is taken twice; take it once"]),
        # neighbours whose ends overlap
        ([{"window": [[0, 10], [6, 30]]}, {"window": [30, 31]}], []),
    ],
)
def test_a_part_of_a_record_is_taken_once(selections, found):
    row = {"manoeuvre": "3211", "control": "elevator", "start": 4.0, "end": 12.0}
    problems: list[str] = []
    taken = [RecordSelection(records=("a",), **one) for one in selections]
    spans_of("fit 'pitch'", taken, {"a": pd.DataFrame([row])}, problems)
    assert problems == [f"fit 'pitch', record a: {text}" for text in found]


def test_a_fit_of_the_workbench_takes_a_window_once():
    windows = [{"record": name, "start": 0.0, "end": 8.0} for name in ("a", "b")]
    assert len(validate_request({"windows": windows, "model": "Cm = 1"}).windows) == 2
    with pytest.raises(SchemaError, match=r"b: 0 \.\.\. 8 s is taken twice; take it once"):
        validate_request({"windows": [*windows, windows[1]], "model": "Cm = 1"})


def test_a_fit_takes_a_record_once(tmp_path):
    """Doubled samples have standard errors that are too small by the square root of two."""
    text = (COMMUTER / "aeromatch.toml").read_text()
    (tmp_path / "aeromatch.toml").write_text(text)
    for item in COMMUTER.iterdir():
        if item.name != "aeromatch.toml":
            (tmp_path / item.name).symlink_to(item)
    assert read_project(tmp_path / "aeromatch.toml").fit[0].records == ("slow", "fast")
    doubled = text.replace('["slow", "fast"]', '["slow", "slow"]', 1)
    (tmp_path / "aeromatch.toml").write_text(doubled)
    with pytest.raises(SchemaError, match=r"fit\.0: record 'slow' is taken twice; take it once"):
        read_project(tmp_path / "aeromatch.toml")


def test_the_separation_keeps_the_buffet():
    buffet = {"buffet_rms": make_term([2.0, 0.0], {"X": [0.0, 1.0]})}
    needed = {name: make_term(5.0) for name in NEEDED}
    old = FlowSeparation(2.5, {**needed, **buffet})
    given = {}
    found = SimpleNamespace(separation=lambda tables: given.update(tables) or "new")
    craft = submodels.with_separation(replace(CRAFT, stall=old), found)
    assert craft.stall == "new"
    assert list(given) == ["buffet_rms"]


def test_next_to_the_ground_effect_stand_its_coefficients_and_those_that_they_depend_on():
    table, polar = (
        make_term([0.4, 0.9], {"alpha": [0.0, 0.1]}),
        make_term([0.02, 0.1], {"CL": [0.0, 1.0]}),
    )
    leaves = {"/CL/basic": table, "/CD/polar": polar, "/CY/beta": table, "/Cm/basic": table}
    database = xr.DataTree.from_dict(leaves)
    database.attrs = {"force_axes": "stability", "title": "of any fit"}

    def taken(*models):
        asked = SimpleNamespace(ground_effect=SimpleNamespace(models=models))
        return submodels.terms_near_ground(asked, database)

    assert [leaf.path for leaf in taken("CD = 1 + alpha").leaves] == ["/CL/basic", "/CD/polar"]
    assert [leaf.path for leaf in taken("Cm = 1").leaves] == ["/Cm/basic"]
    assert taken("CL = 1").attrs == {"force_axes": "stability"}
    assert taken("CL = 1")["CL/basic"].to_dataset().identical(table)


def test_nothing_is_identified_that_nobody_requests():
    project = SimpleNamespace(
        engine=None, controls=Controls(), gear=None, ground_effect=None, stall=None, points={}
    )
    assert submodels.identified_engine(project, CRAFT, {}, {}) is None
    assert submodels.identified_ground_effect(project, {}, {}, None) is None
    assert submodels.identified_stall(project, CRAFT, {}, {}, None) is None
    assert submodels.attached_database(project, "database", []) == "database"
    assert submodels.identified_gear(project, CRAFT, {}, {}, None) is None
    assert submodels.Submodels().found == {}


def test_all_engines_get_the_identified_deck():
    deck = EngineDeck(
        {
            "n2_command": make_term([0.5, 1.0], {"throttle": [0.0, 1.0]}),
            "n2_up_time": make_term(1.0),
            "corrected_thrust": make_term([0.0, 9e3], {"corrected_n2": [0.4, 1.1]}),
        }
    )
    craft = replace(CRAFT, engines=(Jet((0.0, -1.0, 0.0)), Jet((0.0, 1.0, 0.0))))
    found = SimpleNamespace(deck=lambda pla: deck if pla == (0.0, 1.0) else None)
    after = submodels.with_engine(
        craft, SimpleNamespace(engine=EngineSection(points="p.csv")), found
    )
    assert [engine.deck for engine in after.engines] == [deck, deck]
    assert [engine.position for engine in after.engines] == [
        engine.position for engine in craft.engines
    ]


def test_problems_are_raised_together():
    raise_problems(SimpleNamespace(file="p.toml"), [])
    with pytest.raises(SchemaError, match="2 problems"):
        raise_problems(SimpleNamespace(file="p.toml"), ["one", "two"])
