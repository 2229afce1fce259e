"""Tables that a run left: named with variable, end of the range, amount and time; a run below its
runway.
"""

import numpy as np
import pytest

import flightmech
from pom.replaying.run_remarks import TableRange, below_runway, table_ranges, tables_left
from pom.status import NOTICES

TIME = np.arange(0.0, 10.0, 0.02)
DEG = np.pi / 180.0
ALPHA = TableRange("alpha", -8.0 * DEG, 20.0 * DEG, "deg")
FLAP = TableRange("delta_f", 0.0, 40.0 * DEG, "deg")


def left(ranges, steps=12.0, **outputs):
    return tables_left(TIME, {"out_of_range": np.full(TIME.size, steps), **outputs}, ranges)


def test_a_range_that_was_left_is_named():
    alpha = np.where(TIME > 5.0, 22.1 * DEG, 3.0 * DEG)
    (remark,) = left((ALPHA,), alpha=alpha)
    assert (
        remark.text
        == "tables over alpha left: above 20 deg by up to 2.1 deg, at 5.0 s, in 50 % of the "
        "samples; held there"
    )
    assert remark.values == pytest.approx({"limit": 20.0, "beyond": 2.1})
    (remark,) = left((FLAP,), **{"applied.delta_f": -1.0 * DEG + 0.0 * TIME})
    assert remark.text.startswith("tables over delta_f left: below 0 deg by up to 1 deg")


def test_rounding_is_no_leaving():
    assert left((FLAP,), **{"applied.delta_f": 40.0 * DEG + 1e-16 + 0.0 * TIME}) == ()
    noisy = {
        "applied.delta_f": 1e-4 * DEG * np.sin(TIME)
    }  # flaps up, with the noise of their pick-up
    assert left((FLAP, TableRange("engine1.corrected_n1", 0.3, 1.1, "1")), **noisy) == ()


def test_flow_angles_of_an_aeroplane_that_stands_do_not_count():
    V = np.where(TIME < 5.0, 0.5, 60.0)
    assert left((ALPHA,), alpha=np.where(TIME < 5.0, 1.5, 0.1), V=V) == ()
    (remark,) = left((ALPHA,), alpha=0.5 + 0.0 * TIME, V=V)
    assert "in 50 % of the samples" in remark.text


def test_without_a_count_or_a_name():
    assert left((ALPHA,), steps=0.0, alpha=1.0 + TIME) == ()
    (unseen,) = left((ALPHA,))
    assert unseen.text.endswith(
        "12 integration steps, in alpha, which is not an output of the model"
    )
    (unseen,) = left((ALPHA, FLAP))
    assert "in one of alpha, delta_f, which are" in unseen.text
    (foreign,) = left(())
    assert foreign.text.endswith("the FMU does not state in which variable")


def test_the_ranges_are_read_from_the_fmu(trainer, toy, tmp_path):
    flightmech.write_fmu(
        flightmech.compile(trainer.AIRCRAFT, trainer.database()), tmp_path / "m.fmu"
    )
    (found,) = table_ranges(tmp_path / "m.fmu", "0")
    assert found.variable == "alpha"
    np.testing.assert_allclose((found.low, found.high), np.radians([-10.0, 20.0]))
    assert table_ranges(toy(), "0") == ()


def test_an_aeroplane_below_its_runway_is_named():
    h = np.where(TIME > 5.0, 98.5, 103.0)
    (remark,) = below_runway(TIME, {"h": h}, {"env.runway_elevation": 100.0})
    assert remark.kind in NOTICES
    assert remark.text.startswith("c.g. below the runway from 5.0 s on, by up to 1.5 m; give ")
    assert remark.values == pytest.approx({"depth": 1.5})
    assert below_runway(TIME, {"h": h}, {"env.runway_elevation": 98.0}) == ()
    assert below_runway(TIME, {"h": h}, {}) == ()
    assert below_runway(TIME, {}, {}) == ()


def test_a_run_that_failed_below_its_runway_is_named():
    h = np.where(TIME > 5.0, np.nan, -0.5)
    (remark,) = below_runway(TIME, {"h": h}, {})
    assert remark.values == pytest.approx({"depth": 0.5})
