"""Model exchange: the importer's solver flies the same trajectory; modes, states and structure are
as described.
"""

from __future__ import annotations

import ctypes

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from flightmech.fmu_export.description import NOMINAL
from flightmech.simulation.kernel import OUTPUT
from flightmech.simulation.run import initialise_run

VERSIONS = ("2.0", "3.0")
# no feed-through: an output that jumps with an input is recorded on either side of the jump
TRACE = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "h", "engine1.thrust")
SCALE = {"V": 100.0, "h": 100.0, "engine1.thrust": 1e4}
# a rectangular pulse: repeated times are discontinuities, at which FMPy enters event mode and
# starts its solver afresh
PULSE = [
    (0.0, 0.0, 0.0),
    (1.0, 0.0, 0.0),
    (1.0, -0.03, 0.02),
    (1.6, -0.03, 0.02),
    (1.6, 0.0, 0.0),
    (6.0, 0.0, 0.0),
]
PULSE_TYPE = [("time", float), ("delta_e", float), ("delta_a", float)]


def fly(folder, condition, **options):
    """Let FMPy fly the pulse."""
    return fmpy.simulate_fmu(
        str(folder),
        stop_time=6.0,
        start_values=condition,
        input=np.array(PULSE, PULSE_TYPE),
        output=TRACE,
        record_events=False,
        **options,
    )


def differences(found, reference, every: int = 1) -> dict[str, float]:
    """Return the largest difference of every quantity in the unit of its size."""
    return {
        name: float(abs(found[name][::every] - reference[name]).max()) / SCALE.get(name, 1.0)
        for name in TRACE
    }


@pytest.fixture(scope="module")
def stepped(fmus, condition):
    """Fly the pulse in co-simulation, 10 ms Runge-Kutta steps."""
    found = fly(fmus["3.0"], condition, output_interval=0.02)
    assert np.ptp(found["theta"]) > 0.04
    assert np.ptp(found["phi"]) > 0.04
    return found


@pytest.mark.slow
@pytest.mark.parametrize("version", VERSIONS)
def test_cvode_flies_the_trajectory_of_co_simulation(fmus, condition, stepped, version):
    found = fly(fmus[version], condition, fmi_type="ModelExchange", output_interval=0.02)
    # both methods have errors of their own; with CVode at the tolerance of the description the
    # largest is 5.9e-6
    assert max(differences(found, stepped).values()) < 1e-5
    finer = fly(
        fmus[version],
        condition,
        fmi_type="ModelExchange",
        output_interval=0.02,
        relative_tolerance=1e-9,
    )
    assert max(differences(finer, stepped).values()) < 1e-6
    assert differences(finer, stepped)["q"] < 0.2 * differences(found, stepped)["q"]


# FMPy holds the inputs over an output interval and does not start CVode afresh at its end: full
# steps of a control within one are the hardest case. At 1e-7 CVode gives up.
@pytest.mark.nightly
@pytest.mark.parametrize("control", ["delta_e", "delta_a", "delta_r"])
@pytest.mark.parametrize("interval", [0.02, 0.1])
def test_cvode_flies_moving_controls_at_the_default_tolerance(fmus, condition, control, interval):
    time = np.arange(0.0, 10.0, interval)
    wave = np.sin(np.pi * time)
    for signal in (0.1 * wave, 0.3 * np.sign(wave)):
        found = fmpy.simulate_fmu(
            str(fmus["2.0"]),
            stop_time=time[-1],
            start_values=condition,
            input=np.array(
                list(zip(time, signal, strict=True)), [("time", float), (control, float)]
            ),
            output=TRACE,
            output_interval=interval,
            fmi_type="ModelExchange",
        )
        assert found["time"][-1] == pytest.approx(time[-1])


@pytest.mark.nightly
@pytest.mark.parametrize("version", VERSIONS)
def test_euler_comes_closer_in_proportion_to_its_step(fmus, condition, stepped, version):
    coarse, fine = (
        fly(
            fmus[version],
            condition,
            fmi_type="ModelExchange",
            solver="Euler",
            step_size=h,
            output_interval=h,
        )
        for h in (0.002, 0.001)
    )
    first, second = differences(coarse, stepped, 10), differences(fine, stepped, 20)
    for name in ("V", "alpha", "q", "theta", "phi", "h"):
        # first order; higher terms are below 5 % at these steps
        assert first[name] / second[name] == pytest.approx(2.0, rel=0.05), name
    assert second["theta"] < 0.002


@pytest.mark.parametrize("version", VERSIONS)
def test_a_runge_kutta_of_the_importer_is_that_of_the_kernel(
    trainer, exchange, instance, condition, version
):
    """Classical Runge-Kutta over the functions of model exchange: co-simulation does the same
    sums.
    """
    me, cs, h = exchange(version).start(), instance("2.0").start(), 0.01
    n = len(states_of(me))
    open_continuous(me)
    for k in range(100):
        for item in (me, cs):
            item.set({"delta_e": -0.02 if 20 <= k < 60 else 0.0})
        t, x, slopes = k * h, states_of(me), []
        for part, weight in ((0.0, 0.0), (0.5, 0.5), (0.5, 0.5), (1.0, 1.0)):
            me.fmu.setTime(t + part * h)
            put_states(me, x + weight * h * (slopes[-1] if slopes else np.zeros(n)))
            slopes.append(rates_of(me))
        put_states(me, x + h / 6.0 * (slopes[0] + 2.0 * (slopes[1] + slopes[2]) + slopes[3]))
        me.fmu.setTime(t + h)
        me.fmu.completedIntegratorStep()
        cs.step(t, h)
    np.testing.assert_allclose(me.get(*TRACE), cs.get(*TRACE), rtol=1e-12, atol=1e-13)


def states_of(me) -> np.ndarray:
    """Return the continuous states."""
    count = sum(v.name.startswith("state.") for v in me.model.modelVariables)
    x = (fmpy.fmi2.c_double * count)()
    me.fmu.getContinuousStates(x, count)
    return np.array(x)


def rates_of(me) -> np.ndarray:
    """Return the derivatives of the states."""
    count = sum(v.name.startswith("state.") for v in me.model.modelVariables)
    dx = (fmpy.fmi2.c_double * count)()
    (me.fmu.getDerivatives if me.version == "2.0" else me.fmu.getContinuousStateDerivatives)(
        dx, count
    )
    return np.array(dx)


def put_states(me, x: np.ndarray) -> None:
    """Set the continuous states."""
    me.fmu.setContinuousStates((fmpy.fmi2.c_double * len(x))(*x), len(x))


def open_continuous(me) -> None:
    """Go from event mode to continuous-time mode."""
    (me.fmu.newDiscreteStates if me.version == "2.0" else me.fmu.updateDiscreteStates)()
    me.fmu.enterContinuousTimeMode()


# ---- structure


@pytest.mark.parametrize("version", VERSIONS)
def test_states_and_derivatives_are_variables(exchange, version):
    me = exchange(version).start()
    names = [v.name for v in me.model.modelVariables if v.name.startswith("state.")]
    assert me.get(*names) == states_of(me).tolist()
    assert me.get(*(f"der({name})" for name in names)) == rates_of(me).tolist()
    assert [u.variable.name for u in me.model.derivatives] == [f"der({name})" for name in names]
    assert [u.variable.derivative.name for u in me.model.derivatives] == names
    assert me.model.numberOfContinuousStates == len(names)


@pytest.mark.parametrize("version", VERSIONS)
def test_nominals_are_those_of_the_description(exchange, version):
    me = exchange(version).start()
    variables = [v for v in me.model.modelVariables if v.name.startswith("state.")]
    nominals = (fmpy.fmi2.c_double * len(variables))()
    me.fmu.getNominalsOfContinuousStates(nominals, len(variables))
    assert (
        list(nominals)
        == [float(v.nominal or 1.0) for v in variables]
        == [NOMINAL.get(v.unit, 1.0) for v in variables]
    )


@pytest.mark.slow
@pytest.mark.parametrize("earth", [0.0, 1.0])
@pytest.mark.parametrize("name", ["trainer", "everything"])
def test_what_is_not_among_the_dependencies_has_no_effect(
    request, fmus, whole, condition, name, earth
):
    trainer = request.getfixturevalue(name)
    model = fmpy.read_model_description(str((fmus if name == "trainer" else whole)["3.0"]))
    run = initialise_run(trainer, {**condition, "mode.earth": earth}, np.zeros(len(trainer.inputs)))
    rows = [row.name for row in trainer.entries(OUTPUT)]
    state, u = run.state, np.zeros(len(trainer.inputs))
    states = [v.name for v in model.modelVariables if v.name.startswith("state.")]
    known = {
        u.variable.name: {d.name for d in u.dependencies}
        for u in (*model.outputs, *model.derivatives)
        if u.dependencies is not None
    }
    assert len(known) >= 20

    def unknowns(x: np.ndarray, u: np.ndarray) -> dict[str, float]:
        run.state = x
        run.set_inputs(u)
        found = dict(zip(rows, run.outputs(), strict=True))
        return found | {f"der({n})": dx for n, dx in zip(states, run.derivative(x, u), strict=True)}

    base = unknowns(state, u)
    rng = np.random.default_rng(5)
    for i, name in enumerate((*states, *trainer.inputs)):
        x, v = state.copy(), u.copy()
        if i < len(states):
            x[i] += 1e-3 * (abs(x[i]) + 1.0) * rng.uniform(0.5, 1.0)
        else:
            v[i - len(states)] += 0.1
        changed = unknowns(x, v)
        wrong = [out for out, on in known.items() if name not in on and changed[out] != base[out]]
        assert wrong == [], name


# ---- modes


@pytest.mark.parametrize("version", VERSIONS)
def test_modes_are_kept_apart(exchange, instance, version):
    me, cs = exchange(version).start(), instance(version).start()
    enter_event_mode = getattr(cs.fmu.dll, f"fmi{version[0]}EnterEventMode")
    assert enter_event_mode(ctypes.c_void_p(cs.fmu.component)) == 3
    assert cs.messages == [
        "entering event mode belongs to model exchange; this instance is for co-simulation"
    ]
    for act, message in (
        (
            lambda: me.fmu.enterEventMode(),
            "entering event mode is not allowed while the instance is in event mode",
        ),
        (
            lambda: me.fmu.completedIntegratorStep(),
            "completing an integrator step is not allowed while the instance is in event mode",
        ),
        (
            lambda: put_states(me, states_of(me)),
            "setting the states is not allowed while the instance is in event mode",
        ),
    ):
        with pytest.raises(FMICallException):
            act()
        assert me.messages[-1] == message
    open_continuous(me)
    with pytest.raises(FMICallException):
        me.set({"mass.mass": 2600.0})
    assert me.messages[-1] == "mass.mass is a parameter; set it in event mode"
    me.set({"delta_e": 0.01})
    me.fmu.enterEventMode()
    me.set({"mass.mass": 2600.0})
    assert me.get("mass.mass", "delta_e") == [2600.0, 0.01]
    open_continuous(me)
    me.fmu.terminate()
    with pytest.raises(FMICallException):
        me.fmu.setTime(1.0)


@pytest.mark.parametrize("version", VERSIONS)
def test_a_trial_state_that_is_not_finite_is_discarded(exchange, version):
    me = exchange(version).start()
    open_continuous(me)
    x = states_of(me)
    with pytest.raises(FMICallException) as refused:
        put_states(me, np.where(np.arange(len(x)) == 10, np.nan, x))
    assert refused.value.status == 2  # discard: try a smaller step
    assert states_of(me).tolist() == x.tolist()
    with pytest.raises(FMICallException):
        put_states(me, x[:-1])
    assert "states" in me.messages[-1]
    assert np.isfinite(rates_of(me)).all()


@pytest.mark.parametrize("version", VERSIONS)
def test_a_stored_state_belongs_to_its_interface(exchange, instance, version):
    me, cs = exchange(version).start(), instance(version).start()
    kept = cs.fmu.serializeFMUState(cs.fmu.getFMUState())
    stored = me.fmu.deserializeFMUState(kept)
    with pytest.raises(FMICallException):
        me.fmu.setFMUState(stored)
    assert me.messages == [
        "a state of co-simulation does not fit model exchange, nor the other way round"
    ]


@pytest.mark.parametrize("version", VERSIONS)
def test_a_stored_state_keeps_time_and_mode(exchange, version):
    me = exchange(version).start()
    open_continuous(me)
    me.fmu.setTime(2.5)
    state = me.fmu.getFMUState()
    before = rates_of(me)
    x = states_of(me)
    me.fmu.setTime(3.0)
    put_states(me, x * 1.01)
    me.fmu.setFMUState(state)
    assert rates_of(me).tolist() == before.tolist()
    put_states(me, x)
    assert me.get("time" if version == "3.0" else "V") == (
        [2.5] if version == "3.0" else me.get("V")
    )


# ---- what is no state


FORCE = [
    (0.0, 0.0),
    (0.5, 0.0),
    (0.5, 40.0),
    (1.5, 40.0),
    (1.5, -30.0),
    (2.5, -30.0),
    (2.5, 0.0),
    (4.0, 0.0),
]
GUSTY = {
    "turbulence.mode": 1,
    "turbulence.seed": 3,
    "turbulence.sigma_u": 2.0,
    "turbulence.sigma_w": 2.0,
}


@pytest.mark.nightly
@pytest.mark.parametrize(
    "version",
    [VERSIONS[0], *(pytest.param(other, marks=pytest.mark.slow) for other in VERSIONS[1:])],
)
@pytest.mark.parametrize(
    ("case", "signals"),
    [({"mode.controls": 2}, ("theta", "applied.column")), (GUSTY, ("theta", "alpha"))],
)
def test_what_is_no_state_lags_by_a_step_of_the_kernel(whole, condition, version, case, signals):
    """A control system with friction, and turbulence, stand still between events `mode.step` apart:
    an error of first order.
    """
    force, errors = np.array(FORCE, [("time", float), ("F_column", float)]), []
    for step in (0.01, 0.005):
        options = {
            "stop_time": 4.0,
            "output_interval": 0.05,
            "start_values": {**condition, **case, "mode.step": step},
            "input": force,
            "output": signals,
            "record_events": False,
        }
        cs = fmpy.simulate_fmu(str(whole[version]), **options)
        me = fmpy.simulate_fmu(str(whole[version]), fmi_type="ModelExchange", **options)
        np.testing.assert_allclose(me["time"], cs["time"], atol=1e-12)
        errors.append([abs(me[name] - cs[name]).max() for name in signals])
        assert all(
            error < 0.05 * np.ptp(cs[name]) for error, name in zip(errors[-1], signals, strict=True)
        )
    assert np.divide(*errors) == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize(
    ("case", "expected"),
    [({}, [0.01, None]), ({"mode.controls": 2}, [0.01, 0.02, 0.03]), (GUSTY, [0.01, 0.02, 0.03])],
)
def test_events_are_requested_while_something_moves(
    fmus, whole, third_party, version, case, expected
):
    me = third_party((whole if case else fmus)[version], exchange=True).open().start(case)
    found, time = [], 0.0
    while len(found) < len(expected):
        info = (me.fmu.newDiscreteStates if version == "2.0" else me.fmu.updateDiscreteStates)()
        assert [bool(word) for word in info[:2]] == [False, False]
        found.append(info[5] if info[4] else None)
        me.fmu.enterContinuousTimeMode()
        if info[4]:
            time = info[5]
            me.fmu.setTime(time)
            me.fmu.enterEventMode()
    assert found == [None if time is None else pytest.approx(time, abs=1e-12) for time in expected]


@pytest.mark.parametrize("version", VERSIONS)
def test_what_begins_to_move_requires_event_mode(exchange, version):
    me = exchange(version).start()
    open_continuous(me)
    me.fmu.setTime(0.1)
    assert [bool(word) for word in me.fmu.completedIntegratorStep()] == [False, False]
    me.fmu.enterEventMode()
    me.set({"turbulence.mode": 1, "turbulence.sigma_w": 2.0})
    open_continuous(me)
    me.fmu.setTime(0.2)
    assert [bool(word) for word in me.fmu.completedIntegratorStep()] == [True, False]
