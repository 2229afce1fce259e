"""Hostile numbers: a flight ends in finite outputs or in an error with a text, and no step works
without end.
"""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import flightmech
from flightmech.errors import SimulationError
from flightmech.simulation.kernel import Simulation

KERNEL = Path(__file__).parents[2] / "kernel"
MODELS = KERNEL / "fuzz" / "models.py"
EVERY = [0.0, -1.0, 0.5, 1e-300, -1e300, 1e9, -1e9, 1e16]
FLYING = {"init.V": 80.0, "init.h": 1000.0}
STANDING = {"init.V": 0.0, "init.h": 0.415, "mode.earth": 0.0, "gear": 1.0}
ROUGH = {
    "turbulence.mode": 1.0,
    "turbulence.W20": 15.0,
    "turbulence.severity": 5.0,
    "gust.peak_w": 8.0,
}
CASES = [FLYING | ROUGH, FLYING | {"mode.controls": 1.0}, STANDING | {"mode.controls": 2.0}]


@pytest.fixture(scope="module")
def fleet() -> dict[str, flightmech.SimModel]:
    spec = importlib.util.spec_from_file_location("fuzz_models", MODELS)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.compiled()


def outcome(
    sim: flightmech.SimModel, values: dict[str, float], steps: int = 2, dt: float = 0.02
) -> str:
    """Fly with parameters and inputs; return the text of the error, "" for none.  What is not
    finite fails here.
    """
    run, u = Simulation(sim.model), np.zeros(len(sim.inputs))
    try:
        for name, value in values.items():
            if name in sim.inputs:
                u[sim.inputs.index(name)] = value
            elif name in sim.parameters:
                run.set_parameter(sim.parameters.index(name), value)
        run.set_inputs(u)
        run.initialize()
        assert np.isfinite(run.outputs()).all()
        for k in range(steps):
            run.step(dt * k, dt, u, u)
            assert np.isfinite(run.state).all()
        assert np.isfinite(run.outputs()).all()
        run.derivative(run.state, u)
    except SimulationError as error:
        return str(error) or "an error without a text"
    return ""


def reported(text: str, sim: flightmech.SimModel) -> bool:
    """Whether a text names a parameter, state, output or input of the model."""
    names = (*sim.parameters, *sim.outputs, *sim.inputs, *sim.states)
    return text == "" or any(name in text for name in names)


def test_the_fuzzers_call_each_function_of_the_library():
    header = (KERNEL / "include" / "kernel.h").read_text()
    functions = re.findall(r"^AM_API [^;(]*?(am_\w+)\(", header, re.MULTILINE)
    drivers = "".join(file.read_text() for file in (KERNEL / "fuzz").glob("*.c"))
    assert "am_follow_circuit" in functions
    assert [name for name in functions if not re.search(rf"\b{name}\(", drivers)] == []


def test_the_fuzzers_fly_each_model(fleet):
    folders = (KERNEL / "fuzz" / "drive.c").read_text().partition("folder_of_model")[2]
    listed = re.search(r"NAME\[\] = {(.*?)}", folders, re.DOTALL)[1]
    assert set(re.findall(r"\w+", listed)) == set(fleet)
    count = re.search(r"MODELS = (\d+)", (KERNEL / "fuzz" / "drive.h").read_text())[1]
    assert int(count) == len(fleet)


@pytest.mark.parametrize(
    "model",
    ["whole", "plain", "fed", "piston", "electric", "stalling", "supported", "bare", "empty"],
)
def test_the_models_fly(model, fleet):
    for case in CASES if model == "whole" else [FLYING]:
        assert outcome(fleet[model], case, steps=20) == ""


def alone(sim: flightmech.SimModel, case: dict[str, float], values: list[float]) -> None:
    """Give each parameter each value; what is refused must name it."""
    for name in sim.parameters:
        for value in values:
            text = outcome(sim, case | {name: value})
            assert reported(text, sim), (name, value, text)
            if abs(value) > 1e16:
                assert name in text, (name, value, text)


@pytest.mark.nightly
@pytest.mark.parametrize("case", range(len(CASES)))
def test_every_parameter_alone(case, fleet):
    alone(fleet["whole"], CASES[case], EVERY)


@pytest.mark.slow
def test_every_parameter_of_the_small_models_alone(fleet):
    for model in ("plain", "empty"):
        alone(fleet[model], FLYING, EVERY)


ODD = st.one_of(
    st.sampled_from(EVERY), st.floats(-2.0, 2.0), st.floats(allow_nan=False, allow_infinity=False)
)


@pytest.mark.nightly
@settings(
    max_examples=2 * settings.default.max_examples,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_parameters_and_inputs_at_random(data, fleet):
    sim = fleet["whole"]
    names = st.sampled_from((*sim.parameters, *sim.inputs))
    case = data.draw(st.sampled_from(CASES)) | data.draw(
        st.dictionaries(names, ODD, min_size=1, max_size=6)
    )
    assert reported(outcome(sim, case), sim)


@pytest.mark.slow
@settings(
    max_examples=5000, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
@pytest.mark.nightly
def test_many_parameters_and_inputs_at_random(data, fleet):
    sim = fleet["whole"]
    names = st.sampled_from((*sim.parameters, *sim.inputs))
    case = data.draw(st.sampled_from(CASES)) | data.draw(
        st.dictionaries(names, ODD, min_size=1, max_size=20)
    )
    assert reported(outcome(sim, case, steps=10), sim)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_no_number_that_is_not_finite_comes_in(value, fleet):
    sim = fleet["whole"]
    run, u = Simulation(sim.model), np.zeros(len(sim.inputs))
    run.initialize()
    x = run.state
    for i, name in enumerate(sim.parameters):
        with pytest.raises(SimulationError, match=f"^{name} is -?(nan|inf); it must be finite$"):
            run.set_parameter(i, value)
    for i, name in enumerate(sim.inputs):
        bad = u.copy()
        bad[i] = value
        with pytest.raises(SimulationError, match=f"{name.replace('*', '.')} is -?(nan|inf)"):
            run.set_inputs(bad)
        with pytest.raises(SimulationError, match=f"{name} is -?(nan|inf) at t = "):
            run.step(0.0, 0.01, u, bad)
    for i, name in enumerate(sim.states):
        bad = x.copy()
        bad[i] = value
        with pytest.raises(SimulationError, match=f"^{name} is -?(nan|inf); it must be finite$"):
            run.state = bad
    np.testing.assert_array_equal(run.state, x)


@pytest.mark.parametrize("earth", [0.0, 1.0, 2.0, 3.0])
@pytest.mark.parametrize(
    "start",
    [
        {"init.V": 0.0},
        {"init.V": 0.0, "wind_n": 10.0},
        {"init.V": 1e-300},
        {"init.V": 60.0, "init.alpha": np.pi / 2, "init.theta": np.pi / 2},
        {"init.V": 60.0, "init.alpha": np.pi},
        {"init.V": 60.0, "init.alpha": -np.pi / 2, "init.beta": np.pi / 2},
        {"init.V": 60.0, "init.beta": np.pi / 2},
        {"init.V": 3000.0, "init.h": 200e3},
        {"init.V": 60.0, "init.lat": np.pi / 2},
        {"init.V": 60.0, "init.lat": -np.pi / 2, "init.lon": 1e9},
    ],
)
def test_any_attitude_and_place_flies(start, earth, fleet):
    for controls in (0.0, 2.0):
        text = outcome(
            fleet["whole"],
            {"init.h": 1000.0, "mode.earth": earth, "mode.controls": controls} | start,
            steps=25,
        )
        assert text == "", text


@pytest.mark.parametrize("h", [-0.5, -100.0, -1e4])
@pytest.mark.parametrize("speed", [0.0, 60.0])
def test_wheels_under_the_ground(h, speed, fleet):
    """A spring that is compressed by 100 m throws the aircraft into the air, or the integration
    diverges and this is reported.
    """
    for controls in (0.0, 2.0):
        case = {
            "init.V": speed,
            "init.h": h,
            "gear": 1.0,
            "mode.controls": controls,
            "brake_left": 1.0,
        }
        assert reported(outcome(fleet["whole"], case, steps=25), fleet["whole"])


def test_places_where_there_is_no_air_to_fly_in(fleet):
    for h in (-6371007.1809, -6378137.0, -6356766.0, -6.4e6, 1e12):
        for earth in (0.0, 1.0, 2.0):
            assert reported(
                outcome(fleet["whole"], {"init.V": 60.0, "init.h": h, "mode.earth": earth}),
                fleet["whole"],
            )


@pytest.mark.parametrize("t", [float("nan"), float("inf"), 1.1e10, -1e300])
def test_times_without_meaning_are_refused(t, fleet):
    sim = fleet["whole"]
    run, u = Simulation(sim.model), np.zeros(len(sim.inputs))
    with pytest.raises(SimulationError, match=r"the start time is .* within 1e10 s"):
        run.initialize(t)
    run.initialize()
    for start, dt in ((t, 0.01), (0.0, t)):
        with pytest.raises(
            SimulationError, match="must be finite and not negative, times within 1e10 s"
        ):
            run.step(start, dt, u, u)
    with pytest.raises(SimulationError, match=r"the record starts at .* within 1e10 s"):
        run.run(np.array([t]), u[None], hold=False)


def test_the_work_of_a_step_is_bounded(fleet):
    """A step as long as times allow, with turbulence of the finest grid, circuits of the shortest
    sub-step and a lever delay.
    """
    case = {"mode.step": 1e10, "turbulence.step": 1e-3, "column.step": 1e-6} | ROUGH | FLYING
    assert reported(outcome(fleet["whole"], case, steps=1, dt=9e9), fleet["whole"])
    text = outcome(fleet["bare"], FLYING, steps=1, dt=9e9)
    assert text == "9e+09 s are more than 1e9 steps of mode.step = 0.01 s"


@pytest.mark.parametrize("model", ["whole", "plain", "stalling", "supported", "bare", "empty"])
def test_every_index_is_a_parameter_or_none(model, fleet):
    """Nodes, scales and offsets follow the catalogue; between the tables of two stages there are
    numbers that are none.
    """
    sim = fleet[model]
    found = [text_of(sim, i) for i in range(-2, len(sim.parameters) + 800)]
    assert set(found) <= {"", "there is no parameter"}
    assert found[0] == found[1] == found[-1] == "there is no parameter"
    assert "there is no parameter" not in found[2 : 2 + len(sim.parameters)]
    assert model != "empty" or found.count("") == len(sim.parameters)


def text_of(sim: flightmech.SimModel, i: int) -> str:
    """Set a parameter to 1 and read it back; return the text of the refusal without its number."""
    run = Simulation(sim.model)
    try:
        run.set_parameter(i, 1.0)
    except SimulationError as error:
        return str(error).rsplit(" ", 1)[0]
    assert run.parameter(i) == pytest.approx(
        1.0, rel=1e-10
    )  # a node is kept as the change of a value of up to 1e5
    return ""


@pytest.mark.parametrize(
    ("search", "wanted", "text"),
    [
        (
            ([np.nan], [1.0], [-1.0], [1.0]),
            0.0,
            (
                "unknown 0 of the trim lies between 1 and -1 in steps of 1; the limits must be in "
                "order"
            ),
        ),
        (
            ([np.nan], [-1.0], [1.0], [0.0]),
            0.0,
            "in steps of 0; the limits must be in order, the size positive",
        ),
        (([np.nan], [np.nan], [1.0], [1.0]), 0.0, "lies between -?nan and 1"),
        (([np.inf], [-1.0], [1.0], [1.0]), 0.0, "the first guess of unknown 0 of the trim is inf"),
        (([0.0], [-1.0], [1.0], [1.0]), np.inf, "goal 0 of the trim is inf; it must be finite"),
    ],
)
def test_a_trim_without_meaning_is_refused(search, wanted, text, fleet):
    sim = fleet["bare"]
    run = Simulation(sim.model)
    run.set_parameter(sim.parameters.index("init.V"), 80.0)
    run.initialize()
    mover = [(2, sim.parameters.index("init.alpha"), 0)]
    with pytest.raises(SimulationError, match=text):
        run.trim_for(
            0,
            mover,
            tuple(np.array(part) for part in search),
            [sim.outputs.index("trim.w_dot")],
            np.array([wanted]),
        )
