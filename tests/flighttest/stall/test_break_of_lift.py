"""Breaks of the lift: which records show a stall, which do not, and which are undecided."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import stall_records as records
import xarray as xr

from flightmech.errors import UnitError
from flighttest.cli.actions.submodels.airframe import attached_angle, station_of_halves
from flighttest.submodels.stall import break_of_lift


def lift_node(rng, alpha, lift, separated=None, noise=0.02) -> break_of_lift.NodeFit:
    """Return the lift of one record of 0.04 s steps with the design 1, alpha, `separated`."""
    columns = [np.ones_like(alpha), alpha]
    names, is_separated = ["1", "alpha"], [False, False]
    if separated is not None:
        columns.append(separated)
        names.append("alpha*X_lift_loss")
        is_separated.append(True)
    lift = lift + records.coloured(rng, len(alpha), noise)
    samples = SimpleNamespace(pieces=lambda: ([slice(0, len(alpha))], [0.04]))
    A = np.column_stack(columns)
    return break_of_lift.NodeFit(lift, A, tuple(names), tuple(is_separated), 5, samples=samples)


def kirchhoff_loss(alpha, a1, star):
    X = 0.5 * (1.0 - np.tanh(a1 * (alpha - star)))
    return alpha * (1.0 - (0.5 * (1.0 + np.sqrt(X))) ** 2)


@pytest.mark.parametrize(("bend", "is_broken"), [(0.0, False), (2.0, False), (None, True)])
def test_a_lift_without_a_break_is_no_stall(bend, is_broken):
    """A straight lift, a slightly curved one, and one that breaks at 13 deg, up to 15 deg."""
    rng = np.random.default_rng(3)
    alpha = np.radians(10.0 - 5.0 * np.cos(0.6 * np.arange(0.0, 60.0, 0.04)))
    loss = kirchhoff_loss(alpha, 25.0, np.radians(13.0))
    lift = 0.25 + 4.8 * alpha
    lift += -4.8 * loss if bend is None else bend * alpha**2
    signs = break_of_lift.weigh_break(lift_node(rng, alpha, lift, loss))
    assert signs.is_shown is is_broken
    assert signs.is_absent is not is_broken
    text = break_of_lift.describe_missing_break(signs, float(alpha.max()))
    assert is_broken or "the lift shows no break up to the flown 15.0 deg: the slope" in text


def single_stall(seed, star=17.0, bend=0.0):
    """Return the signs in a quasi-steady stall with three times the noise, without a separation."""
    rng = np.random.default_rng(seed)
    _, alpha = records.alpha_history(rng, "quasi-steady", 17.0)
    lift = 0.25 + 4.8 * alpha - 4.8 * kirchhoff_loss(alpha, 22.0, np.radians(star))
    node = lift_node(rng, alpha, lift + bend * alpha**2, noise=0.06)
    return break_of_lift.weigh_break(node)


def test_a_single_stall_with_noise_is_one_by_the_fall_of_its_slope():
    """Schwarz's criterion alone refused 1 of 3 of these, as a curved lift describes them too.

    A lift without a separation, whose slope falls by a fifth, is refused at once.
    """
    for seed in range(4):
        stall = single_stall(seed)
        assert stall.is_shown, seed
        assert "curves without a separation desc" in break_of_lift.describe_soft_break(stall)
        # drag and pitching moment may show the shape that the lift does not
        assert stall.is_soft is not stall._replace(others=100.0).is_soft
        curved = single_stall(seed, star=60.0, bend=-1.45)
        assert not curved.is_shown, seed


def test_a_lift_that_bends_upwards_is_no_stall():
    """With little noise a separation that adds lift was far better than a curved line.

    The slope rises from 4.5 to 5.0 per rad at 12 deg: it was called a stall at 11.6 deg.
    """
    rng = np.random.default_rng(6)
    _, alpha = records.alpha_history(rng, "quasi-steady", 17.0)
    beyond = np.maximum(alpha - np.radians(12.0), 0.0)
    for change, is_stall in ((0.5, False), (-3.0, True)):
        lift = 0.25 + 4.5 * alpha + change * beyond
        signs = break_of_lift.weigh_break(lift_node(rng, alpha, lift, beyond, noise=0.002))
        assert signs.preference > 10.0
        assert signs.is_shown is is_stall
        assert signs.is_absent is not is_stall
        text = break_of_lift.describe_missing_break(signs, 0.35)
        assert ("but the lift bends upwards, and a sep" in text) is not is_stall


def test_a_curved_lift_that_keeps_most_of_its_slope_is_no_stall():
    """With a noise of 0.003 a separation is far better than a parabola: it was called a stall."""
    rng = np.random.default_rng(1)
    _, alpha = records.alpha_history(rng, "quasi-steady", 17.0)
    grid = np.linspace(alpha.min(), alpha.max(), 60)
    for a1, star, share, is_stall in ((14.0, 24.0, 0.5, False), (25.0, 18.0, 1.0, True)):
        loss, part = (kirchhoff_loss(angles, a1, np.radians(star)) for angles in (alpha, grid))
        node = lift_node(rng, alpha, 0.25 + 4.8 * (alpha - share * loss), loss, noise=0.003)
        unknown = break_of_lift.weigh_break(node)
        assert unknown.preference > 10.0
        assert unknown.is_shown
        steady = np.column_stack([grid, np.ones(60), grid, part])
        signs = break_of_lift.weigh_break(node._replace(steady=steady))
        assert signs.is_shown is is_stall
        assert signs.is_absent is not is_stall
        text = "keeps 60 % of the slope in steady flow, a break less than 50 %"
        assert (text in signs.describe()) is not is_stall


def test_a_flap_that_does_not_move_repeats_the_constant():
    rng = np.random.default_rng(5)
    _, alpha = records.alpha_history(rng, "quasi-steady", 17.0)
    node = lift_node(rng, alpha, 0.25 + 4.8 * alpha)
    flap = np.full((len(alpha), 1), 0.6)
    wider = node._replace(
        A=np.hstack([node.A, flap]), terms=(*node.terms, "delta_f"), separated=(False,) * 3
    )
    signs, same = break_of_lift.weigh_break(node), break_of_lift.weigh_break(wider)
    assert same.end == pytest.approx(signs.end)
    assert same.stderr == pytest.approx(signs.stderr)


def test_an_undecided_lift_is_not_called_attached():
    """A slope that is near half of its start, and one with six times the noise."""
    near = break_of_lift.LiftBreak(-3.0, start=5.0, end=2.4, stderr=0.3)
    text = break_of_lift.describe_missing_break(near, 0.3)
    assert text.startswith("undecided whether the lift breaks up to the flown 17.2 deg: the slope")
    assert "goes from 5.00 to 2.40 per rad, a break needs less than 2.50 by 2 stan" in text
    assert "add stalls of the same configuration that are held" in text
    # more stalls of the same slope decide it
    assert near._replace(stderr=0.04).is_shown
    # a lift that does not rise at the start shows nothing by its slope
    assert not near._replace(start=-5.0, end=-9.0).is_shown
    # without a term alpha there is no slope to compare
    assert "the slope" not in break_of_lift.LiftBreak(-3.0).describe()


def test_the_slope_of_a_subtracted_database_counts():
    """The lift on top of a database falls from 0: against its slope, not against zero."""
    rng = np.random.default_rng(4)
    _, alpha = records.alpha_history(rng, "quasi-steady", 17.0)
    total = xr.Dataset({"alpha": ("time", alpha), "CL": ("time", 0.25 + 4.8 * alpha)})
    slope = break_of_lift.database_slope([total], [total.assign(CL=total["CL"] - 4.8 * alpha)])
    assert slope == pytest.approx(4.8)
    on_top = lift_node(rng, alpha, -1.0 * alpha**2)
    assert break_of_lift.weigh_break(on_top, slope=slope).is_absent
    lost = lift_node(rng, alpha, -4.8 * kirchhoff_loss(alpha, 22.0, np.radians(17.0)))
    assert break_of_lift.weigh_break(lost, slope=slope).is_shown


def test_a_station_is_between_the_plane_of_symmetry_and_the_tip():
    """8.5 ft given as 8.5 is beyond the tip; a left half by a minus would exchange both halves."""
    with pytest.raises(
        UnitError, match=r"^--station 8.5: found 8.5 m, beyond the wing tip at 5.15"
    ):
        station_of_halves("8.5", 10.3)
    with pytest.raises(UnitError, match=r"^--station -2.5 m: found -2.5 m; give a distance from"):
        station_of_halves("-2.5 m", 10.3)
    with pytest.raises(UnitError, match=r"^--station"):
        station_of_halves("8 deg", 10.3)
    assert station_of_halves("8.5 ft", 10.3) == pytest.approx(2.5908)
    assert station_of_halves("", 10.3) == pytest.approx(2.575)


def test_an_error_of_an_angle_names_its_option():
    with pytest.raises(UnitError, match=r"^--attached-to 8: found 8 rad, which is 458.4 deg; "):
        attached_angle("8")
    with pytest.raises(UnitError, match=r"^--attached-to: found '8 m'|^--attached-to: .*'m'"):
        attached_angle("8 m")
    assert attached_angle("8 deg") == pytest.approx(0.13963, 1e-4)
    assert attached_angle("0.14") == 0.14
