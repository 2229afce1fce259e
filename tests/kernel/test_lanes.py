"""Runs side by side in the lanes of the processor: the bits of runs one after the other, whatever
the runs do.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.errors import UnknownName
from flightmech.simulation.batch import ControlLoop, Parallelism, fly_batch
from flightmech.simulation.kernel import PARAMETER
from flightmech.simulation.kernel_library import load_kernel
from flightmech.simulation.run import read_inputs

MODELS = Path(__file__).parents[2] / "kernel" / "fuzz" / "models.py"
RUNS = 11  # a group of eight and one of three
TIME = np.arange(0.0, 3.0, 0.02)


@pytest.fixture(scope="module")
def models() -> dict[str, flightmech.SimModel]:
    """The models of the fuzzers: every submodel; one engine and body axes; one constant; no
    term.
    """
    spec = importlib.util.spec_from_file_location("models", MODELS)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found.compiled()


@pytest.fixture(scope="module")
def record() -> xr.Dataset:
    moves = {
        "delta_e": 0.03 * np.sin(3.0 * TIME),
        "delta_a": 0.02 * np.cos(2.0 * TIME),
        "delta_r": np.where(TIME > 1.0, 0.02, 0.0),
    }
    return xr.Dataset({name: ("time", values) for name, values in moves.items()}, {"time": TIME})


def spread(low: float, high: float) -> np.ndarray:
    return np.linspace(low, high, RUNS)


AIR = {
    "init.V": spread(70.0, 150.0),
    "init.h": spread(900.0, 13000.0),
    "init.alpha": spread(-0.1, 0.3),
    "init.beta": spread(0.0, 0.1),
}


def demand_same(sim: flightmech.SimModel, *arguments, **options) -> xr.Dataset:
    """Fly with every number of lanes, demand the same bits and reasons, and return the result."""
    alone = flightmech.simulate_batch(sim, *arguments, failed="nan", lanes=1, **options)
    for lanes in (4, 8):
        found = flightmech.simulate_batch(sim, *arguments, failed="nan", lanes=lanes, **options)
        assert found["failure"].values.tolist() == alone["failure"].values.tolist()
        differing = [
            name
            for name in sim.outputs
            if found[name].values.tobytes() != alone[name].values.tobytes()
        ]
        assert not differing, f"{lanes} lanes"
    return alone


def test_this_processor_has_lanes(sim):
    assert load_kernel().am_lanes(sim.model.handle) in (1, 4, 8)


@pytest.mark.slow
@pytest.mark.parametrize("earth", [0.0, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("trim", [0.0, 1.0])
def test_table_aircraft_on_every_earth(sim, record, earth, trim):
    found = demand_same(sim, record, AIR, {"mode.earth": earth, "mode.trim": trim})
    assert float(np.ptp(found["alpha"].values[:, -1])) > 0.01


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["plain", "stalling", "bare", "empty"])
@pytest.mark.parametrize("drive", [0.0, 2.0])
def test_small_models(models, record, name, drive):
    demand_same(
        models[name],
        record,
        AIR | {"env.delta_T": spread(-20.0, 20.0)},
        {"mode.engine": drive * (name in ("plain", "stalling")), "mode.rates": 1.0},
    )


@pytest.fixture(scope="module")
def together() -> flightmech.SimModel:
    """Every submodel, and coefficients that depend on no other."""
    spec = importlib.util.spec_from_file_location("models", MODELS)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    leaves = {name: leaf for name, leaf in found.air().items() if name != "CD/polar"}
    return flightmech.compile(found.whole(), found._tree(leaves))


MODES = {
    "calm": {},
    "trimmed": {"mode.trim": 1.0},
    "shear": {"wind_n": 5.0, "wind.shear_e": 0.01},
    "boundary layer": {"wind.W20": 8.0, "env.runway_elevation": 100.0},
    "turbulence": {"turbulence.mode": 1.0, "turbulence.seed": 3.0, "turbulence.W20": 12.0},
    "gust": {"gust.peak_w": 8.0, "gust.start": 1.0, "gust.rise": 0.5},
    "thrust": {"mode.engine": 2.0, "engine1.thrust_drive": 3000.0},
    "N1": {"mode.engine": 1.0, "engine1.n1_drive": 0.7},
    "positions": {"mode.controls": 1.0},
    "forces": {"mode.controls": 2.0, "F_column": 10.0},
}


@pytest.mark.nightly
@pytest.mark.parametrize("mode", MODES)
def test_whole_aircraft_in_flight(together, record, mode):
    known = {*together.parameters, *together.inputs}
    assert MODES[mode].keys() <= known, MODES[mode].keys() - known
    throttle = {f"engine{i}.throttle": ("time", 0.6 + 0.3 * np.sin(i * TIME)) for i in (1, 2)}
    demand_same(
        together, record.assign(throttle), AIR | {"mass.mass": spread(2200.0, 2500.0)}, MODES[mode]
    )


@pytest.mark.slow
def test_whole_aircraft_on_the_ground(together, record):
    rolling = {"init.V": spread(0.0, 25.0), "env.runway_elevation": spread(0.0, 50.0)}
    found = demand_same(together, record.assign(gear=1.0), rolling, {"mode.trim": 3.0})
    assert (found["failure"] == "").all()
    assert float(abs(found["h_agl"]).max()) < 5.0


@pytest.mark.slow
def test_legs_wheels_and_runways_that_differ_from_run_to_run(together, record):
    """Dry, wet and icy, with and without anti-skid, rigid wheels next to struts, skids next to
    tyres, some retracted, braked to a skid.
    """
    run = np.arange(RUNS)
    wheels = [
        name.removesuffix(".cornering_stiffness")
        for name in together.parameters
        if name.endswith(".cornering_stiffness")
    ]
    assert len(wheels) > 2
    runway = {
        "runway.condition": run % 3.0,
        "gear.antiskid": np.where(run % 2, 0.8, 0.0),
        "runway.skid_ratio": spread(0.3, 1.0),
    }
    legs = {
        f"{wheels[0]}.tyre_stiffness": np.where(run % 4 == 1, 0.0, 3e5),
        f"{wheels[0]}.preload": np.zeros(RUNS),
    }
    skid = {
        f"{wheels[1]}.friction": np.where(run % 5 == 2, 0.4, 0.0),
        f"{wheels[2]}.retracts": 1.0 * (run % 2),
    }
    hit = {
        "brake_left": ("time", np.where(TIME > 0.5, 1.0, 0.0)),
        "brake_right": 0.3,
        "delta_nw": ("time", 0.2 * np.sin(2.0 * TIME)),
    }
    rolling = {"init.V": np.where(run == 7, 0.0, spread(3.0, 40.0))}
    record = record.assign(hit).assign(gear=("time", 1.0 - 0.1 * TIME), wind_e=4.0)
    found = demand_same(together, record, rolling | runway | legs | skid, {"mode.trim": 3.0})
    assert (found["failure"] == "").all()
    assert float(np.ptp(found["V"].values[:, -1])) > 10.0


def of_each_run(**inputs: np.ndarray) -> dict[str, tuple]:
    return {name: (("run", "time"), values) for name, values in inputs.items()}


def test_engines_that_light_burn_and_run_down_together(together, record):
    """Levers, starters and shut-downs of their own; engines that burn next to some that windmill,
    are cranked, light and go out.
    """
    after = TIME[None, :] > spread(0.2, 2.6)[:, None]
    odd = (np.arange(RUNS) % 2 == 1)[:, None]
    own = of_each_run(
        **{
            "engine1.throttle": 0.5 + 0.4 * np.sin(np.outer(spread(1.0, 4.0), TIME)),
            "engine2.throttle": np.where(after, 0.9, 0.3),
            "engine1.cutoff": 1.0 * (after & odd),
            "engine2.flameout": 1.0 * ((TIME > 0.3) & (TIME < 0.5) & odd),
            "engine2.starter": 1.0 * (after & odd),
            "engine2.ignition": 1.0 * after,
        }
    )
    loads = {
        "init.fuel": np.where(np.arange(RUNS) % 4 == 2, 0.05, 300.0),
        "engine1.lever_delay": np.where(odd[:, 0], 0.0, 0.3),
    }
    limits = {
        "engine1.itt_time": np.where(odd[:, 0], 0.0, 1.5),
        "engine2.time_constant": np.where(odd[:, 0], 0.4, 0.0),
    }
    found = demand_same(together, record.assign(own), AIR | loads | limits)
    assert (found["failure"] == "").all()
    for engine in ("engine1", "engine2"):
        burning = found[f"{engine}.burning"].values
        assert ((burning > 0.9).any(axis=0) & (burning < 0.1).any(axis=0)).any()
    assert 0 < int((found["fuel"].values[:, -1] <= 0.0).sum()) < RUNS


def test_one_run_touches_the_ground_next_to_others_that_fly(together, record):
    heights = np.where(np.arange(RUNS) == 5, 1.5, spread(3.0, 3000.0))
    controls = {"gear": 1.0, "brake_left": 0.4, "delta_nw": ("time", 0.05 * np.sin(TIME))}
    low = {
        "init.V": spread(45.0, 60.0),
        "init.h": heights,
        "pedal.nose_spring": np.where(np.arange(RUNS) % 2, 0.0, 2000.0),
    }
    found = demand_same(
        together, record.assign(controls), low, {"init.gamma": -0.04, "init.alpha": 0.1}
    )
    touched = np.any(
        [found[name].values.any(axis=1) for name in found if str(name).startswith("wow_")], axis=0
    )
    assert touched[5]
    assert 0 < int(touched.sum()) < RUNS


@pytest.mark.slow
@pytest.mark.parametrize("order", [0.0, 2.0, 4.0])
def test_steered_wheels_in_the_air(together, record, order):
    """Wheels on a spring next to castors."""
    command = record.assign(delta_nw=("time", np.where(TIME > 0.5, 0.3, 0.0)))
    stiffness = {"steering.stiffness": np.where(np.arange(RUNS) % 3, 3000.0, 0.0)}
    found = demand_same(
        together, command, AIR | stiffness, {"steering.order": order, "steering.trail": 0.1}
    )
    assert (found["failure"] == "").all()
    assert float(np.ptp(found["gear.steering"].values[:, -1])) > 0.1


@pytest.mark.nightly
def test_circuits_and_wheels_of_different_orders(together, record):
    """Such runs fly alone; circuits of one order and different geometry side by side."""
    even = np.arange(RUNS) % 2 == 0
    geometry = {
        "column.gearing_slope": spread(-0.1, 0.1),
        "column.bob_weight": spread(0.0, 3.0),
        "wheel.friction": spread(0.0, 20.0),
    }
    held = demand_same(together, record, AIR | geometry)
    assert float(np.ptp(held["applied.F_column"].values[:, -1])) > 1.0
    for orders in (
        {"column.order": np.where(even, 2.0, 4.0)},
        {"steering.order": np.where(even, 0.0, 2.0)},
    ):
        assert (demand_same(together, record, AIR | orders)["failure"] == "").all()


@pytest.mark.filterwarnings("ignore:.* reaches .*, its limit is")
@pytest.mark.nightly
@pytest.mark.parametrize("mode", [1.0, 2.0])
@pytest.mark.parametrize("order", [2.0, 4.0])
@pytest.mark.parametrize("hold", ["linear", "zero"])
def test_circuits_that_move(together, record, mode, order, hold):
    """Forces and travels of their own that break loose, stick, pass neutral and meet stops; levers
    that jump in some runs.
    """
    wave = np.outer(spread(0.2, 1.5), np.sin(5.0 * TIME))
    after = (TIME > 0.8)[None, :] * spread(0.0, 1.0)[:, None]
    forces = of_each_run(
        F_column=150.0 * wave, F_wheel=8.0 * wave + 10.0 * after, F_pedal=-300.0 * wave
    )
    travels = of_each_run(column=0.12 * wave, wheel=0.8 * wave - 0.3 * after, pedal=0.05 * wave)
    own = record.drop_vars(list(record.data_vars)).assign(forces if mode == 2.0 else travels)
    own = own.assign(of_each_run(**{"engine1.throttle": np.where(after > 0.5, 0.9, 0.4)}))
    orders = {f"{name}.order": np.full(RUNS, order) for name in ("column", "pedal")}
    unlike = {
        "column.friction": spread(0.0, 40.0),
        "wheel.preload": spread(0.0, 10.0),
        "pedal.step": spread(0.0005, 0.003),
    }
    lag = {
        "engine1.lever_delay": np.where(np.arange(RUNS) % 3, 0.1, 0.0),
        "wheel.step": np.where(np.arange(RUNS) == 4, 0.02, 0.001),
    }
    found = demand_same(
        together,
        own,
        AIR | orders | unlike | lag,
        {"mode.controls": mode, "mode.trim": 1.0},
        hold=hold,
    )
    assert (found["failure"] == "").sum() > 6
    assert float(np.ptp(found["applied.delta_e"].values[:, -1])) > 0.005


@pytest.mark.parametrize("hold", ["linear", "zero"])
def test_loops_that_are_closed_sample_by_sample(together, record, hold):
    """A pitch attitude held by force through circuits that move, a bank angle by the wheel; one run
    fails.
    """
    time, names = record["time"].values, ["theta", "phi", "applied.delta_e"]
    loops = [
        ControlLoop("F_column", "theta", 400.0, 200.0, 60.0, 0.05 * np.sin(time)),
        ControlLoop("F_wheel", "phi", 20.0, 5.0, 6.0, np.full(time.size, 0.1), True),
    ]
    start = {
        "mode.controls": 2.0,
        "mode.trim": 1.0,
        "mode.step": 0.01,
        "init.V": 120.0,
        "init.h": 3000.0,
    }
    varied = {
        "mass.mass": spread(2200.0, 2500.0),
        "bias.Cm": np.where(np.arange(RUNS) == 4, 1e200, 0.0),
    }
    u = read_inputs(together, record.drop_vars(list(record.data_vars)), start, time.size, RUNS)
    found = []
    for lanes in (1, 4, 8):
        found.append(
            fly_batch(
                together,
                time,
                u,
                list(varied),
                np.stack([*varied.values()], 1),
                start,
                names,
                hold,
                Parallelism(lanes=lanes),
                loops=loops,
            )
        )
    for y, done, texts in found[1:]:
        assert y.tobytes() == found[0][0].tobytes()
        assert (done.tolist(), texts) == (found[0][1].tolist(), found[0][2])
    y, _, texts = found[0]
    assert [bool(text) for text in texts] == [run == 4 for run in range(RUNS)]
    free, *_ = fly_batch(
        together, time, u, list(varied), np.stack([*varied.values()], 1), start, names, hold
    )
    assert float(np.nanmax(np.abs(y - free))) > 0.02


def test_a_loop_of_nothing_is_refused(together, record):
    time = record["time"].values
    loops = [ControlLoop("F_column", "theta", 1.0, 0.0, 1.0, np.zeros(time.size))] * 17
    u = read_inputs(together, record, {}, time.size, 1)
    _, _, (text,) = fly_batch(
        together, time, u, ["init.V"], np.array([[120.0]]), {}, ["theta"], loops=loops
    )
    assert "at most 16 loops" in text
    with pytest.raises(UnknownName, match="thta"):
        fly_batch(
            together,
            time,
            u,
            ["init.V"],
            np.array([[120.0]]),
            {},
            ["theta"],
            loops=[loops[0]._replace(output="thta")],
        )


def test_a_loop_without_numbers_ends_the_runs_of_a_group_as_one_alone(together, record):
    time = record["time"].values
    loop = ControlLoop("F_column", "theta", 1.0, 0.0, 1.0, np.where(time > 0.1, np.nan, 0.0))
    u = read_inputs(together, record.drop_vars(list(record.data_vars)), {}, time.size, 8)
    start, speeds = {"mode.controls": 2.0}, np.linspace(100.0, 120.0, 8)[:, None]
    (one, steps, words), (y, done, texts) = (
        fly_batch(
            together,
            time,
            u,
            ["init.V"],
            speeds,
            start,
            ["theta"],
            parallelism=Parallelism(lanes=lanes),
            loops=[loop],
        )
        for lanes in (1, 0)
    )
    assert y.tobytes() == one.tobytes()
    assert (done.tolist(), texts) == (steps.tolist(), words)
    assert "F_column" in texts[0]


@pytest.mark.filterwarnings("ignore:delta_e reaches")
def test_a_whole_aircraft_that_fails_leaves_the_others_alone(together, record):
    """Deflections without meaning in two runs, in one of them from one second on."""
    start = np.where(np.arange(RUNS) == 1, 0.0, np.where(np.arange(RUNS) == 6, 1.0, np.inf))
    own = of_each_run(delta_e=np.where(start[:, None] < TIME, 1e200, record["delta_e"].values))
    found = demand_same(together, record.assign(own), AIR)
    assert np.flatnonzero(found["failure"].values != "").tolist() == [1, 6]
    known = np.isfinite(found["V"].values)
    assert known[1].sum() < 3 < known[6].sum() < TIME.size
    assert known[[0, 2, 3, 4, 5]].all()


def test_a_force_that_depends_on_coefficients(models, record):
    demand_same(models["whole"], record, AIR)


def test_a_run_that_fails_leaves_the_others_alone(sim, record):
    mass = spread(2200.0, 2500.0)
    mass[2] = -1.0
    inertia = np.full(RUNS, 30000.0)
    inertia[[4, 9]] = 1e-9  # the motion diverges
    found = demand_same(
        sim,
        record,
        {"mass.mass": mass, "mass.Iyy": inertia} | AIR,
        {"mass.Ixz": 0.0, "mass.Ixy": 0.0, "mass.Iyz": 0.0},
    )
    assert "must be positive" in found["failure"].values[2]
    failed = [bool(text) for text in found["failure"].values]
    assert 1 < sum(failed) < RUNS
    assert np.isfinite(found["V"].values[[not text for text in failed]]).all()


@pytest.mark.nightly
@pytest.mark.parametrize("mode", [0.0, 2.0])
def test_scales_that_are_zero_in_some_runs_or_in_all(together, record, mode):
    """A term is left out where its scale is zero in every run of a group: of four or eight here, of
    one alone.
    """
    scales = {name: np.ones(RUNS) for name in together.parameters if name.startswith("term.")}
    for k, column in enumerate(scales.values()):
        column[k % 3 :: 2 + k % 5] = 0.0
    for name in ("term.Cm.elevator", "term.Ch_a.delta", "term.CD.gear", "term.CL.alphadothat"):
        scales[name][:] = 0.0
    flown = demand_same(together, record, AIR | scales, {"mode.controls": mode})
    assert (flown["failure"] == "").sum() > 6
    assert (flown["applied.delta_a"].values != 0.0).any()


def test_mixed_modes_and_changed_tables(sim, record):
    earth = np.where(np.arange(RUNS) % 3, 1.0, 0.0)
    demand_same(sim, record, AIR | {"mode.earth": earth})
    term = next(name for name in sim.parameters if name.startswith("term.Cm")).removeprefix("term.")
    demand_same(
        sim,
        record,
        AIR | {f"table.{term}": spread(0.9, 1.1), f"offset.{term}": spread(-0.01, 0.01)},
    )


ONE_CELL = {
    "init.V": spread(100.0, 100.1),
    "init.alpha": spread(0.02, 0.021),
    "init.h": spread(3000.0, 3001.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("air", [AIR, ONE_CELL], ids=["apart", "one cell"])
def test_changed_nodes_of_tables_with_one_to_four_axes(sim, record, air):
    """Nodes at both ends of their axes and inside, of a factor and of two tables over the same
    axes, in cells that lanes share or not.
    """
    factor = np.arange(RUNS) / RUNS
    one = {f"node.CD.basic[{k}]": 0.03 + 0.01 * k * factor for k in range(6)} | {
        "node.CL.ground.K1[2]": 0.05 * factor
    }
    two = {f"node.CL.basic[{k},1]": 0.2 + 0.3 * k * factor for k in (0, 2, 3, 5)} | {
        "node.Cl.beta[2,1]": -0.2 * factor
    }
    four = {f"node.Cn.basic[1,{i},{j},1]": 0.01 * factor for i in (0, 1) for j in (0, 1)}
    changed = {
        "offset.CD.basic": 0.01 * factor,
        **one,
        **two,
        "table.CL.basic": 1.0 - 0.1 * factor,
        **four,
    }
    found = demand_same(sim, record, air | changed, {"init.gamma": 0.0})
    for name in ("node.CD.basic[2]", "node.CL.basic[2,1]", "node.Cn.basic[1,0,0,1]"):
        others = {key: values for key, values in changed.items() if key != name}
        without = flightmech.simulate_batch(
            sim, record, air | others, {"init.gamma": 0.0}, failed="nan"
        )
        assert not np.array_equal(without["az"].values, found["az"].values, equal_nan=True), name


def test_inputs_of_each_run_and_held_inputs(sim, record):
    own = record.assign(
        delta_e=(("run", "time"), np.outer(spread(0.5, 1.5), record["delta_e"].values))
    )
    for hold in ("linear", "zero"):
        found = demand_same(sim, own, AIR, {"init.gamma": 0.02}, hold=hold, step=0.007)
        for run in (0, RUNS - 1):
            held = {name: values[run] for name, values in AIR.items()} | {"init.gamma": 0.02}
            one = flightmech.simulate(sim, own.isel(run=run), held, hold=hold, step=0.007)
            assert np.array_equal(one["q"], found["q"][run])


def steps(size: float) -> tuple:
    """Return an input that jumps every ten samples, in each run at samples of its own: it stays in
    some runs where it jumps in others.
    """
    jumps = size * np.random.default_rng(0).normal(size=(RUNS, TIME.size // 10)).repeat(10, axis=1)
    return ("run", "time"), np.array([np.roll(values, run) for run, values in enumerate(jumps)])


def test_held_inputs_that_jump_in_some_runs_in_a_gust(together, record):
    """A run whose inputs stay goes on from what its outputs have found, also where others begin
    anew.
    """
    own = record.drop_vars(list(record.data_vars)).assign(delta_e=steps(0.03))
    calm = AIR | {"init.V": spread(20.0, 150.0), "init.alpha": spread(0.0, 0.1)}
    demand_same(
        together, own, calm, {"gust.peak_w": 50.0, "gust.start": 0.0, "gust.rise": 5.0}, hold="zero"
    )


@pytest.mark.slow
def test_held_forces_that_jump_in_some_runs(together, record):
    own = record.drop_vars(list(record.data_vars)).assign(
        F_column=steps(60.0), F_pedal=steps(180.0)
    )
    found = demand_same(
        together,
        own,
        AIR | {"init.h": spread(900.0, 9000.0)},
        {"mode.controls": 2.0, "mode.trim": 1.0},
        hold="zero",
    )
    assert int(np.diff(found["out_of_range"].values).max()) > 0


def drawn(sim: flightmech.SimModel, rng: np.random.Generator) -> tuple[xr.Dataset, dict, dict, str]:
    """Return a record, what varies from run to run, what is common and how inputs are held, of any
    modes, parameters and inputs.
    """
    runs, samples = int(rng.integers(2, 12)), int(rng.integers(5, 50))
    options = {"mode.earth": 4, "mode.controls": 3, "mode.trim": 2, "mode.engine": 3}
    common = {name: float(rng.integers(0, count)) for name, count in options.items()}
    common["mode.step"] = float(rng.choice([0.007, 0.01, 0.02]))
    for air in (
        {"turbulence.mode": 1.0, "turbulence.W20": 10.0},
        {"gust.peak_w": 20.0, "gust.rise": 0.3},
        {"wind.W20": 8.0},
    ):
        common |= air if rng.random() < 0.3 else {}
    common |= {f"{name}.order": 4.0 for name in ("column", "wheel", "pedal") if rng.random() < 0.4}
    height = (1.0, 5.0) if rng.random() < 0.4 else (100.0, 12000.0)
    varied = {
        "init.V": rng.uniform(20.0, 150.0, runs),
        "init.h": rng.uniform(*height, runs),
        "init.alpha": rng.uniform(-0.1, 0.3, runs),
    }
    free = [
        entry
        for entry in sim.model.entries(PARAMETER)
        if entry.name.startswith(("term.", "gear.", "column.", "pedal.", "engine1.", "mass."))
    ]
    for k in rng.choice(len(free), rng.integers(0, 6), replace=False):
        if free[k].name not in common and abs(free[k].value) < 1e15:
            varied[free[k].name] = free[k].value * np.where(
                rng.random(runs) < 0.3, 1.0, rng.uniform(0.8, 1.2, runs)
            )
    inputs = {}
    for name in rng.choice(list(sim.inputs), rng.integers(0, 7), replace=False):
        size = (
            50.0
            if name.startswith("F_")
            else 0.05
            if name.startswith(("delta", "col", "ped", "whe"))
            else 0.5
        )
        stays = int(rng.integers(1, 15))
        values = (size * rng.normal(size=(runs, samples)))[:, np.arange(samples) // stays]
        values = np.array(
            [np.roll(row, shift) for row, shift in zip(values, rng.integers(0, stays, runs))]
        )
        inputs[str(name)] = (
            ("run", "time"),
            values if size != 0.5 else np.clip(np.abs(values), 0.0, 1.0),
        )
    return (
        xr.Dataset(inputs, {"time": 0.02 * np.arange(samples)}),
        varied,
        common,
        str(rng.choice(["linear", "zero"])),
    )


@pytest.mark.filterwarnings("ignore:.* reaches .*, its limit is")
@pytest.mark.slow
@pytest.mark.nightly
def test_any_batch(together):
    """Three hundred of any modes, parameters and inputs; of these 27 differed while lanes whose
    inputs stay lost their anchor.
    """
    rng = np.random.default_rng(4)
    flown = 0
    for _ in range(300):
        record, varied, common, hold = drawn(together, rng)
        found = demand_same(together, record, varied, common, hold=hold)
        flown += int((found["failure"] == "").all())
    assert flown > 100
