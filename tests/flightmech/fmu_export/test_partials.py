"""Directional and adjoint derivatives: those of the kernel's own linear model, and of plain
differences through the FMU.
"""

from __future__ import annotations

from ctypes import c_double
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

import flightmech

VERSIONS = ("2.0", "3.0")
CONTROLS = ("delta_e", "delta_a", "delta_r")
SEEN = ("nz", "ay", "q_dot", "p_dot", "r_dot", "alpha_dot")


def jacobian(slave, unknowns, knowns) -> np.ndarray:
    """Return the partial derivatives column by column."""
    rows, columns = ([slave.references[name] for name in names] for names in (unknowns, knowns))
    return np.array(
        [slave.fmu.getDirectionalDerivative(rows, [column], [1.0]) for column in columns]
    ).T


def states(slave) -> list[str]:
    return [name for name in slave.references if name.startswith("state.")]


@pytest.mark.parametrize("version", VERSIONS)
def test_controls_act_as_in_the_linear_model(trainer, instance, condition, version):
    """Two central differences of the same model at the same trim: each is within 1e-9 of its row,
    which the trims' ends dominate.
    """
    slave = instance(version).start({"mode.earth": 0.0})
    linear = flightmech.linearize(
        trainer, {**condition, "mode.earth": 0.0}, inputs=CONTROLS, outputs=SEEN
    )
    expected = linear["D"].values
    np.testing.assert_allclose(
        jacobian(slave, SEEN, CONTROLS), expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max()
    )


@pytest.mark.parametrize("version", VERSIONS)
def test_the_jacobian_is_that_of_differences_through_the_fmu(exchange, condition, version):
    """A = d(state rates)/d(states) by setting the states of model exchange, five times as far; rows
    in the unit of their largest entry.

    Sizes: 1 m, 1 cm/s and so on; what is cut off and rounded stays below 1e-6 of a row.
    """
    me = exchange(version).start({"mode.earth": 1.0})
    names, steps = states(me), []
    unknowns = [f"der({name})" for name in names]
    found = jacobian(me, unknowns, names)
    (me.fmu.newDiscreteStates if version == "2.0" else me.fmu.updateDiscreteStates)()
    me.fmu.enterContinuousTimeMode()
    middle = np.array(me.get(*names))
    expected = np.empty_like(found)
    for k, name in enumerate(names):
        size = (
            1.0
            if name in ("state.x", "state.y", "state.z", "state.engine1.thrust")
            else 1e-2
            if name.startswith("state.v")
            else 3e-5
        )
        rates = []
        for sign in (1.0, -1.0):
            x = middle.copy()
            x[k] += sign * size
            pointer = (c_double * len(x))(*x)
            me.fmu.setContinuousStates(pointer, len(x))
            rates.append(np.array(me.get(*unknowns)))
        steps.append(size)
        expected[:, k] = (rates[0] - rates[1]) / (2.0 * size)
    scale = np.abs(expected * np.array(steps)).max(axis=1, keepdims=True)
    assert np.abs((found - expected) * np.array(steps) / scale).max() < 1e-6


@pytest.mark.parametrize("version", VERSIONS)
def test_nothing_of_the_instance_moves(instance, version):
    one, other = instance(version).start(), instance(version).start()
    before = one.get(*SEEN, "out_of_range", *states(one))
    jacobian(one, [*SEEN, "der(state.q)"], [*CONTROLS, "state.vx", "state.engine1.thrust"])
    assert one.get(*SEEN, "out_of_range", *states(one)) == before
    for item in (one, other):
        item.step(0.0, 0.5)
    assert one.get(*SEEN) == other.get(*SEEN)


def test_a_seed_of_several_knowns_and_the_adjoint(instance):
    """J v and J^T w of the same matrix: v' (J^T w) = w' (J v)."""
    slave = instance("3.0").start()
    knowns, unknowns = [*CONTROLS, "state.vz", "state.q"], [*SEEN, "der(state.r)"]
    J = jacobian(slave, unknowns, knowns)
    rows, columns = ([slave.references[name] for name in names] for names in (unknowns, knowns))
    rng = np.random.default_rng(4)
    v, w = rng.normal(size=len(knowns)), rng.normal(size=len(unknowns))
    np.testing.assert_allclose(
        slave.fmu.getDirectionalDerivative(rows, columns, v.tolist()), J @ v, rtol=1e-13, atol=1e-12
    )
    np.testing.assert_allclose(
        slave.fmu.getAdjointDerivative(rows, columns, w.tolist(), nSensitivity=len(columns)),
        J.T @ w,
        rtol=1e-13,
        atol=1e-12,
    )


@pytest.mark.parametrize("version", VERSIONS)
def test_what_has_no_partial_derivatives_is_refused(instance, version):
    slave = instance(version)
    for unknown, known, text in (
        (
            "V",
            "delta_e",
            "reading partial derivatives is not allowed while the instance is instantiated",
        ),
        ("delta_e", "delta_e", "is not an output or a state derivative"),
        ("V", "mass.mass", "is not an input or a state"),
    ):
        with pytest.raises(FMICallException):
            slave.fmu.getDirectionalDerivative(
                [slave.references[unknown]], [slave.references[known]], [1.0]
            )
        assert text in slave.messages[-1]
        if "instantiated" in text:
            slave.start()


@pytest.mark.parametrize("version", VERSIONS)
def test_the_description_offers_them(fmus, version):
    """FMI 2.0 section 2.2.7 and FMI 3.0 section 2.4.9 give the flags."""
    flags = (
        ("providesDirectionalDerivative",)
        if version == "2.0"
        else ("providesDirectionalDerivatives", "providesAdjointDerivatives")
    )
    root = ET.parse(fmus[version] / "modelDescription.xml").getroot()
    for name in ("ModelExchange", "CoSimulation"):
        assert [root.find(name).get(flag) for flag in flags] == ["true"] * len(flags)
