"""The time stepping of linkage.c, compiled alone: closed forms of free motion, dry friction, stops,
two and three masses; energy.
"""

from __future__ import annotations

import ctypes
import subprocess
import sys
from ctypes import c_bool, c_double, c_int
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

SOURCE = Path(__file__).parents[2] / "kernel" / "src"
FREE = 1e9  # a stop that is never reached

Three = c_double * 3


class Linkage(ctypes.Structure):
    """linkage_t."""

    _fields_ = [
        *(
            (name, Three)
            for name in (
                "mass",
                "damping",
                "load",
                "load_rate",
                "stiffness",
                "origin",
                "friction",
                "breakout",
            )
        ),
        ("preload", c_double),
        ("neutral", c_double),
        ("low", Three),
        ("high", Three),
        *(
            (name, c_double)
            for name in ("restitution", "cable_stiffness", "cable_damping", "drive")
        ),
        ("bodies", c_int),
        ("driven", c_bool),
    ]


class Motion(ctypes.Structure):
    """motion_t."""

    _fields_ = [(name, Three) for name in ("q", "v", "friction", "stop", "lost")]


@pytest.fixture(scope="module")
def advance(tmp_path_factory):
    """linkage_advance of a library that holds nothing else."""
    pytest.importorskip("ziglang", reason="the compiler of the build, ziglang, is not installed")
    library = tmp_path_factory.mktemp("linkage") / "linkage.so"
    flags = [
        "-std=c11",
        "-O2",
        "-ffp-contract=off",
        "-fno-sanitize=all",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-shared",
        "-fPIC",
    ]
    sources = [f"-I{SOURCE / 'base'}", str(SOURCE / "controls" / "linkage.c")]
    subprocess.run(
        [sys.executable, "-m", "ziglang", "cc", *flags, *sources, "-o", str(library), "-lm"],
        check=True,
    )
    call = ctypes.CDLL(str(library)).linkage_advance
    call.argtypes, call.restype = (
        [ctypes.POINTER(Linkage), ctypes.POINTER(Motion), c_double, c_int],
        None,
    )
    return lambda linkage, motion, h, parts=1: call(
        ctypes.byref(linkage), ctypes.byref(motion), h, parts
    )


def three(value) -> Three:
    return Three(*np.resize(np.atleast_1d(np.asarray(value, float)), 3))


def linkage(bodies: int = 1, **values) -> Linkage:
    """Return a linkage without friction and stops; a number counts for all bodies, breakout is the
    friction unless given.
    """
    values = {"mass": 1.0, "low": -FREE, "high": FREE, **values}
    values.setdefault("breakout", values.get("friction", 0.0))
    vectors = {name for name, kind in Linkage._fields_ if kind is Three}
    return Linkage(
        bodies=bodies,
        **{name: three(value) if name in vectors else value for name, value in values.items()},
    )


def motion(q=0.0, v=0.0) -> Motion:
    return Motion(q=three(q), v=three(v))


def flown(advance, given: Linkage, m: Motion, h: float, steps: int, load=None) -> np.ndarray:
    """Return q of all bodies after every step (steps + 1, 3); `load` gives the load on body 0 at a
    time.
    """
    rows = [list(m.q)]
    for k in range(steps):
        if load is not None:
            given.load[0], given.load_rate[0] = load(k * h), (load((k + 1) * h) - load(k * h)) / h
        advance(given, m, h)
        rows.append(list(m.q))
    return np.array(rows)


def energy(c: Linkage, m: Motion) -> float:
    """Kinetic energy, springs, preload, cables and constant loads. [J]"""
    total = c.preload * abs(m.q[0] - c.neutral)
    for i in range(c.bodies):
        total += (
            0.5 * c.mass[i] * m.v[i] ** 2
            + 0.5 * c.stiffness[i] * (m.q[i] - c.origin[i]) ** 2
            - c.load[i] * m.q[i]
        )
        total += 0.5 * c.cable_stiffness * (m.q[i] - m.q[0]) ** 2
    return total


# ---- closed forms without friction
# ---------------------------------------------------------------------------------------


def test_step_response_of_second_order(advance):
    """m s'' + W s' + C s = F from rest; midpoint rule, error (omega h)^2 / 12 per radian of
    phase.
    """
    mass, W, C, F, h = 8.0, 30.0, 900.0, 45.0, 1e-3
    t = h * np.arange(1501)
    omega, damping = np.sqrt(C / mass), W / (2.0 * np.sqrt(C * mass))
    own = omega * np.sqrt(1.0 - damping**2)
    exact = (
        F
        / C
        * (
            1.0
            - np.exp(-damping * omega * t)
            * (np.cos(own * t) + damping * omega / own * np.sin(own * t))
        )
    )
    found = flown(advance, linkage(mass=mass, damping=W, stiffness=C, load=F), motion(), h, 1500)[
        :, 0
    ]
    assert np.abs(found - exact).max() < F / C * 2e-5


def test_overbalanced_surface_runs_away(advance):
    """A negative stiffness: x = x0 cosh(lambda t), within (lambda h)^2."""
    found = flown(advance, linkage(mass=2.0, stiffness=-50.0), motion(1e-3), 1e-3, 600)[:, 0]
    assert found == pytest.approx(1e-3 * np.cosh(5.0 * 1e-3 * np.arange(601)), rel=25e-6)


@pytest.mark.parametrize("friction", [0.0, 4.0])
def test_second_order_of_the_step(advance, friction):
    """Halving the sub-step divides the error by four, with reversals and sticking inside the
    sub-steps too.
    """

    def end(h):
        given = linkage(
            mass=2.0, damping=1.0, stiffness=300.0, friction=friction, breakout=1.5 * friction
        )
        return flown(advance, given, motion(0.2, 0.3), h, round(0.9 / h))[-1, 0]

    coarse, middle, fine = (end(h) for h in (4e-3, 2e-3, 1e-3))
    assert (coarse - middle) / (middle - fine) == pytest.approx(4.0, abs=0.35)


def test_frequencies_of_two_masses(advance):
    """Fourth order: forward and aft mass on a cable, springs to the airframe at both ends."""
    mass, C, cable = np.array([6.0, 2.5]), np.array([500.0, 1200.0]), 9000.0
    K = np.diag(C) + cable * np.array([[1.0, -1.0], [-1.0, 1.0]])
    check_modes(advance, mass, C, cable, K)


def test_frequencies_of_three_masses(advance):
    """Sixth order: the wheel and two ailerons, each on its own cable."""
    mass, C, cable = np.array([0.9, 0.25, 0.4]), np.array([4.0, 60.0, 90.0]), 300.0
    K = np.diag(C) + cable * np.array([[2.0, -1.0, -1.0], [-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]])
    check_modes(advance, mass, C, cable, K)


def check_modes(advance, mass, C, cable, K):
    """Started in one mode, the motion stays in it with the frequency of the mode as the midpoint
    rule has it.
    """
    values, shapes = np.linalg.eig(K / mass[:, None])
    h = 1e-3
    for value, shape in zip(values, shapes.T, strict=True):
        given = linkage(
            len(mass), mass=[*mass, 1.0][:3], stiffness=[*C, 0.0][:3], cable_stiffness=cable
        )
        found = flown(advance, given, motion([*shape, 0.0][:3]), h, 400)[:, : len(mass)]
        omega = 2.0 / h * np.arctan(0.5 * h * np.sqrt(value))
        assert omega == pytest.approx(np.sqrt(value), rel=1.1 * value * h**2 / 12.0)
        assert np.abs(found - np.outer(np.cos(omega * h * np.arange(401)), shape)).max() < 1e-10


def test_step_response_of_fourth_order(advance):
    """Damped, force on the forward mass, against the matrix exponential."""
    from scipy.linalg import expm

    mass, W, C, cable, slack, F, h = (
        np.array([6.0, 2.0]),
        np.array([25.0, 8.0]),
        np.array([200.0, 900.0]),
        6000.0,
        12.0,
        60.0,
        5e-4,
    )
    coupling = np.array([[1.0, -1.0], [-1.0, 1.0]])
    K, D, M1 = np.diag(C) + cable * coupling, np.diag(W) + slack * coupling, np.diag(1.0 / mass)
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-M1 @ K, -M1 @ D]])
    rest = np.concatenate([np.linalg.solve(K, [F, 0.0]), np.zeros(2)])
    exact = np.array([rest - expm(A * t) @ rest for t in (0.1, 0.35, 0.9)])[:, :2]
    given = linkage(
        2,
        mass=mass,
        damping=W,
        stiffness=C,
        cable_stiffness=cable,
        cable_damping=slack,
        load=[F, 0.0, 0.0],
    )
    found = flown(advance, given, motion(), h, 1800)[[200, 700, 1800], :2]
    assert found == pytest.approx(exact, abs=2e-5 * np.abs(exact).max())


# ---- dry friction
# --------------------------------------------------------------------------------------------------


def test_amplitude_falls_linearly_under_dry_friction(advance):
    """Every half cycle takes 2 F_c / C, until the spring no longer overcomes the friction; there
    the body stays.
    """
    mass, C, friction, start = 3.0, 700.0, 14.0, 0.33
    found = flown(
        advance, linkage(mass=mass, stiffness=C, friction=friction), motion(start), 1e-3, 4000
    )[:, 0]
    drop, band = 2.0 * friction / C, friction / C
    peaks = [start]
    while abs(peaks[-1]) > band:
        peaks.append(-np.sign(peaks[-1]) * (abs(peaks[-1]) - drop))
    turns = [
        0,
        *(k for k in range(1, 4000) if (found[k] - found[k - 1]) * (found[k + 1] - found[k]) < 0.0),
    ]
    assert len(peaks) == 9
    # a turning point lies at most half a sub-step from a sample: q'' h^2 / 8 off
    assert found[turns] == pytest.approx(peaks[:-1], abs=C * start / mass * 1e-6 / 8.0)
    assert found[-1] == pytest.approx(peaks[-1], abs=1e-6)
    assert (found[-500:] == found[-1]).all()


def test_time_of_half_a_cycle_is_not_changed_by_dry_friction(advance):
    mass, C, friction, h = 3.0, 700.0, 14.0, 1e-4
    m, given, time = motion(0.33), linkage(mass=mass, stiffness=C, friction=friction), 0.0
    while m.v[0] <= 0.0:
        advance(given, m, h)
        time += h
    assert time == pytest.approx(np.pi * np.sqrt(mass / C), abs=1.5 * h)


def test_rest_lasts_for_ever(advance):
    """At 99.9 % of the breakout force nothing moves, in any of 100 000 sub-steps and at either
    end.
    """
    given = linkage(
        2,
        mass=[5.0, 2.0, 1.0],
        friction=[10.0, 6.0, 0.0],
        breakout=[12.0, 6.0, 0.0],
        cable_stiffness=4000.0,
    )
    given.load = Three(11.988 - 8.0, 5.994 + 8.0, 0.0)
    m = motion([0.05, 0.052, 0.0])
    before = list(m.q)
    advance(given, m, 100.0, 100000)
    assert list(m.q) == before
    assert list(m.v)[:2] == [0.0, 0.0]


@pytest.mark.nightly
def test_slow_force_sweep_draws_a_loop_as_wide_as_the_friction(advance):
    """Force against travel, up and down slowly: two lines apart by 2 F_c, and nothing moves inside
    the band.
    """
    C, friction, breakout, h = 400.0, 15.0, 20.0, 1e-3
    given = linkage(mass=0.5, damping=20.0, stiffness=C, friction=friction, breakout=breakout)
    m, period = motion(), 40.0

    def force(t):
        x = t / period - 0.25
        return 80.0 * (1.0 - 4.0 * abs(x - np.floor(x + 0.5)))

    t = h * np.arange(int(2.5 * period / h) + 1)
    F = np.array([force(at) for at in t])
    s = flown(advance, given, m, h, len(t) - 1, force)[:, 0]
    last = t > 1.5 * period
    falling, rising = (
        last & (np.sign(np.gradient(F)) == sign) & (np.abs(s) < 0.1) for sign in (-1.0, 1.0)
    )
    up, down = (
        np.interp([-0.05, 0.0, 0.05], np.sort(s[part]), np.sort(F[part]))
        for part in (rising, falling)
    )
    # viscous force of the sweep: 20 N s/m at 8 N/s / 400 N/m = 0.4 N on either side
    assert up - down == pytest.approx(2.0 * friction + 0.8, abs=0.02)
    assert F[np.argmax(s > 0.0)] == pytest.approx(breakout, abs=0.02)


def test_friction_on_both_ends_of_a_cable(advance):
    """The pilot moves his end by the stretch that the friction aft allows before the surface
    follows.
    """
    cable, friction = 5000.0, [4.0, 25.0, 0.0]
    given = linkage(
        2, mass=[2.0, 1.0, 1.0], damping=[40.0, 10.0, 0.0], friction=friction, cable_stiffness=cable
    )
    given.load_rate[0] = 28.9 / 5.0
    m = motion()
    advance(given, m, 5.0, 5000)
    assert m.q[1] == 0.0
    # viscous friction of 40 N s/m at 28.9 / 5 / 5000 m/s takes 0.05 N
    assert m.q[0] == pytest.approx((28.9 - 4.0 - 0.05) / cable, abs=0.02 / cable)
    advance(given, m, 0.1, 100)  # load restarts at zero: the cable alone does not move the surface
    assert m.q[1] == 0.0
    given.load[0], given.load_rate[0] = 29.2, 0.0
    advance(given, m, 1.0, 1000)
    assert m.q[1] > 0.0


# ---- centring, stops, drive
# ----------------------------------------------------------------------------------------------


def test_preload_holds_neutral_until_it_is_overcome(advance):
    given = linkage(
        mass=2.0, damping=30.0, stiffness=200.0, origin=0.01, preload=9.0, neutral=0.01, load=8.99
    )
    m = motion(0.01)
    advance(given, m, 10.0, 10000)
    assert m.q[0] == 0.01
    given.load[0] = 11.0
    advance(given, m, 10.0, 10000)
    assert m.q[0] == pytest.approx(0.01 + 2.0 / 200.0, abs=1e-9)
    given.load[0] = 0.0
    advance(given, m, 10.0, 10000)
    assert m.q[0] == pytest.approx(0.01, abs=1e-12)


def test_preload_alone_gives_parabolas(advance):
    """A constant centring force: the period is 4 sqrt(2 m s / P), and no energy is lost in passing
    neutral.
    """
    mass, preload, start, h = 2.0, 9.0, 0.08, 1e-3
    period = 4.0 * np.sqrt(2.0 * mass * start / preload)
    found = flown(
        advance, linkage(mass=mass, preload=preload), motion(start), h, round(5.25 * period / h)
    )[:, 0]
    at = h * np.arange(len(found))
    crossings = at[1:][np.diff(np.sign(found)) != 0.0]
    assert len(crossings) == 11
    assert crossings == pytest.approx(period * (0.25 + 0.5 * np.arange(11)), abs=2 * h)
    assert np.abs(found).max() == pytest.approx(start, rel=1e-9)


@pytest.mark.parametrize("restitution", [0.0, 0.4, 1.0])
def test_bounce_off_a_stop(advance, restitution):
    """Falling from rest on a stop: heights go with the square of the restitution."""
    load, gap = 30.0, 0.05
    given = linkage(mass=2.0, load=load, high=gap, restitution=restitution)
    m = motion()
    fall = np.sqrt(2.0 * gap * 2.0 / load)
    advance(given, m, fall * max(1.0 + restitution, 1.01), 137)
    assert m.q[0] == pytest.approx(gap * (1.0 - restitution**2), abs=1e-9)
    assert m.lost[2] == pytest.approx(load * gap * (1.0 - restitution**2), rel=1e-9)
    advance(given, m, 20.0, 20000)
    assert m.q[0] <= gap
    if restitution < 1.0:
        assert m.q[0] == gap
        assert m.stop[0] == pytest.approx(load)


def test_driven_end_moves_as_reported(advance):
    """A prescribed cockpit end drags the aft mass, here in closed form: x = v t - v sin(omega t) /
    omega.
    """
    mass, cable, speed, h = 1.5, 2000.0, 0.3, 1e-3
    given = linkage(2, mass=[1.0, mass, 1.0], cable_stiffness=cable, driven=True, drive=speed)
    found = flown(advance, given, motion(0.0, [speed, 0.0, 0.0]), h, 300)
    t, omega = h * np.arange(301), np.sqrt(cable / mass)
    assert found[:, 0] == pytest.approx(speed * t, abs=1e-14)
    assert found[:, 1] == pytest.approx(
        speed * t - speed * np.sin(omega * t) / omega, abs=speed / omega * 2e-3
    )


# ---- energy, for anything
# ------------------------------------------------------------------------------------------------

positive = st.floats(0.01, 100.0)
share = st.one_of(st.just(0.0), st.floats(0.0, 50.0))
place = st.integers(-(10**6), 10**6).map(
    lambda micro: micro * 1e-6
)  # stops and neutral are apart by a micrometre or coincide


@st.composite
def any_linkage(draw):
    bodies = draw(st.integers(1, 3))
    friction = [draw(share) for _ in range(3)]
    values = {
        "mass": [draw(positive) for _ in range(3)],
        "damping": [draw(share) for _ in range(3)],
        "stiffness": [draw(st.floats(0.0, 1e5)) for _ in range(3)],
        "load": [draw(st.floats(-200.0, 200.0)) for _ in range(3)],
        "origin": [draw(place) for _ in range(3)],
        "friction": friction,
        "breakout": [f * draw(st.floats(1.0, 2.0)) for f in friction],
        "preload": draw(share),
        "neutral": draw(place),
        "low": [-abs(draw(place)) for _ in range(3)],
        "high": [abs(draw(place)) for _ in range(3)],
        "restitution": draw(st.floats(0.0, 1.0)),
        "cable_stiffness": draw(st.floats(0.0, 1e6)),
        "cable_damping": draw(share),
    }
    q = [
        low + draw(st.floats(0.0, 1.0)) * (high - low)
        for low, high in zip(values["low"], values["high"], strict=True)
    ]
    return linkage(bodies, **values), motion(q, [draw(st.floats(-10.0, 10.0)) for _ in range(3)])


@pytest.mark.nightly
@settings(max_examples=3 * settings.default.max_examples, deadline=None)
@given(start=any_linkage(), h=st.floats(1e-5, 0.05))
def test_energy_is_never_made_and_always_accounted_for(advance, start, h):
    """Whatever the numbers and the sub-step: friction, dampers and stops only take, and what they
    take is what is missing.
    """
    given, m = start
    scale = energy(given, m) + sum(abs(given.load[i]) * 1.5 for i in range(3)) + 1.0
    scale += sum(given.stiffness[i] * 6.25 for i in range(3)) + given.cable_stiffness * 9.0
    before, lost = energy(given, m), [0.0, 0.0, 0.0]
    for _ in range(60):
        advance(given, m, h)
        after = energy(given, m)
        taken = [m.lost[k] - lost[k] for k in range(3)]
        assert np.isfinite(after)
        assert min(taken) >= -1e-12 * scale
        assert before - after == pytest.approx(sum(taken), abs=1e-11 * scale)
        assert all(given.low[i] <= m.q[i] <= given.high[i] for i in range(given.bodies))
        before, lost = after, list(m.lost)


@pytest.mark.nightly
@settings(max_examples=settings.default.max_examples, deadline=None)
@given(start=any_linkage(), h=st.floats(1e-4, 0.01))
def test_what_comes_to_rest_stays(advance, start, h):
    """Once all bodies rest, no bit changes any more."""
    given, m = start
    given.friction = Three(*(f + 60.0 for f in given.friction))
    given.breakout = Three(
        *(max(a, b) for a, b in zip(given.friction, given.breakout, strict=True))
    )
    given.load, given.damping = three(0.0), Three(*(w + 20.0 for w in given.damping))
    advance(given, m, 2000 * h, 2000)
    if any(m.v[i] != 0.0 for i in range(given.bodies)):
        return
    advance(given, m, h)
    if any(m.v[i] != 0.0 for i in range(given.bodies)):
        return
    before = bytes(m.q)
    advance(given, m, 1000 * h, 1000)
    assert bytes(m.q) == before


@pytest.mark.nightly
@settings(max_examples=3 * settings.default.max_examples // 2, deadline=None)
@given(start=any_linkage(), h=st.floats(1e-5, 0.02))
def test_forces_obey_the_laws_of_friction_and_stops(advance, start, h):
    """Friction within its bounds and against the motion; a stop only pushes back."""
    given, m = start
    for _ in range(20):
        advance(given, m, h)
        for i in range(given.bodies):
            assert abs(m.friction[i]) <= max(given.friction[i], given.breakout[i]) * (1.0 + 1e-12)
            assert abs(m.stop[i]) < 1e-300 or (
                m.q[i] == given.high[i] if m.stop[i] > 0.0 else m.q[i] == given.low[i]
            )
