"""Regions of hand-made databases, where the right one is known by construction."""

import numpy as np
import pytest
import xarray as xr

from flightmech.envelope.envelope import make_envelope, pack_envelope, unpack_envelope
from flightmech.envelope.regions import (
    A_PRIORI,
    BETWEEN,
    EXTRAPOLATED,
    FLOWN,
    axis_code,
    inside_hull,
    unwrap_about,
    wrap_angle,
)
from flightmech.envelope.term_regions import LEAST_EFFECT, flown_nodes, term_region_table
from flightmech.errors import UnknownName
from flightmech.flown_states import FLOWN_STATES, gather_states, pack_states
from flightmech.terms import SOURCES, make_term

FLIGHT = SOURCES.index("flight")
DEGREES = np.radians([-10.0, -5.0, 0.0, 5.0, 10.0, 15.0, 20.0])


def lift(flown=(1, 2, 3), stderr=0.01, **more):
    """Return a lift curve over alpha whose nodes `flown` are from flight."""
    leaf = make_term(
        0.3 + 5.0 * DEGREES, {"alpha": DEGREES}, stderr=stderr, source="datcom", **more
    )
    leaf["source"].values[list(flown)] = FLIGHT
    return leaf


def region(leaf, name="CL/basic", states=None, **state):
    """Return region and axis of one state in degrees of alpha and beta."""
    table = term_region_table(name, leaf, states)
    if table is None:
        return FLOWN, 0
    radians = {
        key: np.radians(value) if key in ("alpha", "beta") else value
        for key, value in state.items()
    }
    found, axis = table.look_up({key: radians.get(key, 0.0) for key in table.axes})
    return int(found), int(axis)


@pytest.mark.parametrize(
    ("alpha", "expected"),
    [
        (0.0, FLOWN),
        (5.0, FLOWN),
        (7.0, FLOWN),
        (8.0, A_PRIORI),
        (20.0, A_PRIORI),
        (20.1, A_PRIORI),
        (21.0, EXTRAPOLATED),
        (-9.0, A_PRIORI),
        (-11.0, EXTRAPOLATED),
    ],
)
def test_one_axis(alpha, expected):
    # nodes -5, 0 and 5 deg are flown, each with half of its cell; 1 % of the range is slack
    assert region(lift(), alpha=alpha) == (expected, axis_code("alpha") if expected else 0)


def test_gap_between_flown_nodes():
    leaf = lift(flown=(0, 6))
    assert region(leaf, alpha=-10.0)[0] == region(leaf, alpha=20.0)[0] == FLOWN
    assert region(leaf, alpha=5.0) == (BETWEEN, axis_code("alpha"))


def test_one_node_flown():
    leaf = lift(flown=(3,))
    assert region(leaf, alpha=5.0)[0] == FLOWN
    assert region(leaf, alpha=0.0)[0] == region(leaf, alpha=10.0)[0] == A_PRIORI


def test_standard_error_that_is_no_number():
    leaf = lift(stderr=0.01)
    leaf["stderr"].values[2] = np.nan
    assert flown_nodes(leaf).tolist() == [False, True, False, True, False, False, False]
    # between two flown nodes, no longer flown
    assert region(leaf, alpha=0.0)[0] == BETWEEN


def test_leaf_without_standard_errors_is_no_evidence():
    assert not flown_nodes(lift().drop_vars("stderr")).any()


@pytest.mark.parametrize("decision", ["keep", "delete"])
def test_declined_correction(decision):
    leaf = lift().assign_attrs(decision=decision)
    assert region(leaf, alpha=0.0)[0] == A_PRIORI
    assert region(lift().assign_attrs(decision="replace"), alpha=0.0)[0] == FLOWN


def test_axis_of_length_one_states_no_dependence():
    value = np.full((1, 3), 0.5)
    axes = {"mach": [0.2], "alpha": np.radians([0.0, 5.0, 10.0])}
    leaf = make_term(value, axes, stderr=0.01, source="flight")
    assert region(leaf, alpha=5.0, mach=0.9) == (FLOWN, 0)
    assert region(leaf, alpha=12.0, mach=0.9) == (EXTRAPOLATED, axis_code("alpha"))


def test_term_of_no_effect_does_not_decide():
    small = make_term(
        np.full(7, 0.5 * LEAST_EFFECT["CL"]), {"alpha": DEGREES}, stderr=0.0, source="datcom"
    )
    assert term_region_table("CL/basic", small, None) is None
    # the same value with a standard error that counts
    uncertain = small.assign(stderr=small["stderr"] + 2.0 * LEAST_EFFECT["CL"])
    assert region(uncertain, alpha=0.0) == (A_PRIORI, 0)


def test_regressor_counts_from_its_size_on():
    # 0.1 gear against 0.002: counts from gear 0.02 on
    leaf = make_term(0.1, regressors=["gear"], stderr=0.0, source="judgement")
    assert region(leaf, "CD/gear", gear=0.0)[0] == FLOWN
    assert region(leaf, "CD/gear", gear=0.019)[0] == FLOWN
    assert region(leaf, "CD/gear", gear=0.021)[0] == A_PRIORI
    assert region(leaf, "CD/gear", gear=1.0) == (A_PRIORI, axis_code("gear"))


def test_zero_by_definition_next_to_a_flown_setting():
    axes = {"delta_f": np.radians([0.0, 20.0, 40.0])}
    leaf = make_term([0.0, 0.3, 0.5], axes, stderr=[0.0, 0.01, 0.1], source="datcom")
    leaf["source"].values[1] = FLIGHT
    assert flown_nodes(leaf).tolist() == [True, True, False]
    assert region(leaf, "CL/flap", delta_f=np.radians(20.0))[0] == FLOWN
    assert region(leaf, "CL/flap", delta_f=np.radians(40.0)) == (A_PRIORI, axis_code("delta_f"))


def test_free_air_and_slow_air_are_no_extrapolation():
    axes = {"mach": [0.2, 0.4], "h_agl": [1.0, 10.0]}
    leaf = make_term([[0.3, 0.3], [0.3, 0.3]], axes, stderr=0.01, source="flight")
    assert region(leaf, h_agl=5000.0, mach=0.1) == (FLOWN, 0)
    assert region(leaf, h_agl=0.5, mach=0.3) == (EXTRAPOLATED, axis_code("h_agl"))
    assert region(leaf, h_agl=5.0, mach=0.41) == (EXTRAPOLATED, axis_code("mach"))


def test_angle_that_repeats():
    """Flown at -175 and 175 deg only: the far side is between them, the near side is not."""
    beta = np.radians(np.arange(-180.0, 181.0, 5.0))
    leaf = make_term(0.1 + 0.0 * beta, {"beta": beta}, stderr=0.01, source="datcom")
    for degrees in (-175.0, 175.0):
        leaf["source"].values[np.argmin(np.abs(beta - np.radians(degrees)))] = FLIGHT
    assert region(leaf, "CY/basic", beta=176.0)[0] == FLOWN
    assert region(leaf, "CY/basic", beta=179.9)[0] == BETWEEN
    assert region(leaf, "CY/basic", beta=0.0)[0] == A_PRIORI
    # one turn more is the same state
    assert region(leaf, "CY/basic", beta=-184.0) == region(leaf, "CY/basic", beta=176.0)


def test_angles():
    assert wrap_angle("alpha", np.array([4.0])) == pytest.approx([4.0 - 2.0 * np.pi])
    assert wrap_angle("delta_f", np.array([4.0])) == [4.0]
    assert unwrap_about(np.radians([170.0, -170.0])) == pytest.approx(0.0)
    assert abs(unwrap_about(np.radians([-5.0, 10.0]))) > np.radians(170.0)


def test_hull_of_boxes_on_a_line():
    low = np.array([[0.0, 0.0], [1.0, 1.0]])
    points = np.array([[0.6, 0.6], [0.6, 0.0], [1.1, 1.1], [2.0, 2.0]])
    assert inside_hull(low, low + 0.2, points).tolist() == [True, False, True, False]
    assert not inside_hull(low[:0], low[:0], points).any()


def samples(alpha, mach, beta=0.0, delta_f=0.0, gear=0.0):
    """Return samples; angles in degrees."""
    arrays = np.broadcast_arrays(
        np.radians(alpha), np.asarray(mach, float), np.radians(beta), np.radians(delta_f), gear
    )
    return dict(zip(("alpha", "mach", "beta", "delta_f", "gear"), arrays, strict=True))


def database(*parts, **terms):
    """Return a database of flown terms over all axes, with the states of samples."""
    leaves = {"CL/basic": lift(flown=range(7)), **terms}
    tree = xr.DataTree.from_dict({f"/{name}": leaf for name, leaf in leaves.items()})
    tree.attrs[FLOWN_STATES] = pack_states(gather_states(parts))
    return tree


SPEEDS = np.linspace(0.2, 0.4, 41)
CLEAN = samples(np.linspace(8.0, 2.0, 41), SPEEDS, beta=np.linspace(-4.0, 4.0, 41))


def at(envelope, **state):
    """Return region and axis of the envelope at a state; angles in degrees."""
    angles = ("alpha", "beta", "delta_f")
    full = {"alpha": 5.0, "mach": 0.3, "beta": 0.0, **state}
    full = {key: np.radians(x) if key in angles else x for key, x in full.items()}
    found, axis = envelope.look_up(full)
    return int(found), int(axis)


def test_evidence_of_a_flight():
    envelope = make_envelope(database(CLEAN))
    assert at(envelope) == (FLOWN, 0)
    # every node is flown, yet no flight was at 8 deg and Mach 0.4
    assert at(envelope, alpha=8.0, mach=0.4)[0] == A_PRIORI
    assert at(envelope, mach=0.55) == (A_PRIORI, axis_code("mach"))
    assert at(envelope, beta=8.0) == (A_PRIORI, axis_code("beta"))
    assert at(envelope, gear=1.0) == (A_PRIORI, axis_code("gear"))
    assert at(envelope, alpha=25.0)[0] == EXTRAPOLATED


def test_between_two_flights_and_two_flap_settings():
    slow, fast = samples(8.0, 0.2), samples(2.0, 0.4)
    envelope = make_envelope(database(slow, fast))
    assert at(envelope, alpha=5.0, mach=0.3)[0] == BETWEEN
    assert at(envelope, alpha=8.0, mach=0.2)[0] == FLOWN
    flaps = make_envelope(database(CLEAN, {**CLEAN, "delta_f": CLEAN["delta_f"] + np.radians(20)}))
    assert at(flaps, delta_f=20.0) == (FLOWN, 0)
    assert at(flaps, delta_f=10.0) == (BETWEEN, axis_code("delta_f"))
    assert at(flaps, delta_f=30.0) == (A_PRIORI, axis_code("delta_f"))


def test_worst_term_decides_where_it_counts():
    damping = make_term(0.2, regressors=["gear"], stderr=0.02, source="judgement")
    gear = {**CLEAN, "gear": CLEAN["gear"] + 1.0}
    envelope = make_envelope(database(CLEAN, gear, **{"CD/gear": damping}))
    assert at(envelope, gear=0.0) == (FLOWN, 0)
    assert at(envelope, gear=1.0) == (A_PRIORI, axis_code("gear"))


def test_constant_that_no_flight_informed():
    """A derivative without axes is a-priori everywhere, on no axis, and joins the other tables."""
    leaves = {
        "/CL/basic": lift(range(7)),
        "/Cm/qhat": make_term(-13.0, regressors=["qhat"], stderr=5.0, source="datcom"),
    }
    db = xr.DataTree.from_dict(leaves)
    samples = {"alpha": np.linspace(0.0, 0.1, 20), "mach": np.full(20, 0.3)}
    db.attrs[FLOWN_STATES] = pack_states(gather_states([samples]))
    found, axis = make_envelope(db).look_up({"alpha": [0.05, 0.6], "mach": 0.3})
    assert found.tolist() == [A_PRIORI, EXTRAPOLATED]
    assert axis.tolist() == [0, axis_code("alpha")]


def test_damaged_states_leave_the_nodes():
    tree = database(CLEAN)
    tree.attrs[FLOWN_STATES] = "no states"
    envelope = make_envelope(tree)
    assert envelope.states is None
    assert at(envelope, mach=0.55) == (FLOWN, 0)


def test_bytes_of_an_envelope():
    envelope = make_envelope(database(CLEAN))
    names = ["h", *envelope.axes]
    again = unpack_envelope(pack_envelope(envelope, names), names)
    rng = np.random.default_rng(2)
    near = rng.integers(0, 41, 500)
    states = {
        "alpha": CLEAN["alpha"][near] + rng.normal(0.0, 0.1, 500),
        "beta": CLEAN["beta"][near],
        "mach": CLEAN["mach"][near] + rng.normal(0.0, 0.01, 500),
        "gear": rng.choice([0.0, 0.0, 1.0], 500),
    }
    assert np.array_equal(again.look_up(states), envelope.look_up(states))
    assert set(envelope.look_up(states)[0]) >= {FLOWN, A_PRIORI, EXTRAPOLATED}
    assert unpack_envelope(b"", names) is None


def test_missing_variable_and_missing_number():
    envelope = make_envelope(database(CLEAN))
    with pytest.raises(UnknownName, match="alpha"):
        envelope.look_up({"mach": 0.3, "beta": 0.0})
    assert at(envelope, beta=np.nan) == (EXTRAPOLATED, axis_code("beta"))
