"""The file of a multibody vehicle and its joints: faults by name, gears and four-bars against the
closure of the loop.
"""

import copy

import numpy as np
import pytest

from flightmech.errors import SchemaError
from flightmech.support.toml_models import validate_content
from flighttest.special_tests.multibody.mechanics import joint_angles, tree_posture
from flighttest.special_tests.multibody.vehicle import Vehicle, read_vehicle

WING = {
    "parent": "body",
    "at": [0.06, 0.03, -0.03],
    "axis": [1, 0, 0],
    "mass": "0.04 kg",
    "inertia": [1e-3, 1e-4, 1.1e-3],
}
GOOD = {
    "body": {
        "body": {"mass": "0.3 kg", "inertia": [1e-3, 2e-3, 2e-3],
            "markers": {"a": [0.1, 0, 0], "b": [0, 0.1, 0], "c": [0, 0, 0.1]}},
        "crank": {"parent": "body", "at": [0.06, 0.03, 0.03], "axis": [1, 0, 0],
            "mass": "0.003 kg"},
        "rod": {"parent": "crank", "at": [0, 0, -0.011], "axis": [1, 0, 0], "mass": "0.002 kg"},
        "right": WING,
        "left": {**WING, "at": [0.06, -0.03, -0.03]},
    },
    "linkage": {
        "stroke": {
            "crank": "crank", "coupler": "rod", "rocker": "right",
            "pin_on_coupler": [0, 0.025, -0.057], "pin_on_rocker": [0, 0.025, 0],
        }
    },
    "gear": {"left": {"follows": "right", "ratio": -1}},
    "reference": {"S": "0.27 m2"},
    "cameras": {"flapping_frequency": "5 Hz"},
}  # fmt: skip


def vehicle(**changes):
    content = copy.deepcopy(GOOD)
    for place, value in changes.items():
        part = content
        *path, last = place.split("__")
        for key in path:
            part = part.setdefault(key, {})
        part[last] = value
    return validate_content(Vehicle, content, "vehicle.toml")


def test_the_independent_joint_of_a_four_bar_is_its_crank():
    found = vehicle()
    assert found.base == "body"
    assert found.independent == ("crank",)
    assert set(found.joints) == {"crank", "rod", "right", "left"}


@pytest.mark.parametrize("branch", [1, -1])
def test_the_four_bar_meets_its_pin_and_derivatives_are_those_of_the_angles(branch):
    found = vehicle(linkage__stroke__branch=branch)
    theta = np.linspace(0.0, 2.0 * np.pi, 50)[:, None]
    tree = tree_posture(found, theta)
    np.testing.assert_allclose(
        tree.point("rod", (0, 0.025, -0.057)), tree.point("right", (0, 0.025, 0)), atol=1e-15
    )
    h = 1e-5
    over, under, now = (joint_angles(found, theta + d) for d in (h, -h, 0.0))
    change = (over.angle - under.angle + np.pi) % (2.0 * np.pi) - np.pi
    np.testing.assert_allclose(
        now.slope, change / (2.0 * h), atol=1e-9
    )  # rounding of the differences
    np.testing.assert_allclose(now.bend, (over.slope - under.slope) / (2.0 * h), atol=1e-9)
    place = tree.point("rod", (0, 0.01, -0.02))
    moved = [tree_posture(found, theta + d).point("rod", (0, 0.01, -0.02)) for d in (h, -h)]
    np.testing.assert_allclose(
        tree.jacobian("rod", place)[..., 0], (moved[0] - moved[1]) / (2.0 * h), atol=1e-10
    )


def test_a_gear_mirrors_the_wing():
    joints = joint_angles(vehicle(gear__left__offset="2 deg"), np.array([[1.0], [2.0]]))
    right, left = (vehicle().joints.index(name) for name in ("right", "left"))
    np.testing.assert_allclose(joints.angle[:, left], np.radians(2.0) - joints.angle[:, right])
    np.testing.assert_allclose(joints.bend[:, left], -joints.bend[:, right])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"body__right__parent": "trunk"},
            "body.right.parent: 'trunk' is unknown; allowed: body, crank",
        ),
        ({"body__body__parent": "right"}, "bodies without a parent: none"),
        ({"body__right__parent": None}, "bodies without a parent: body, right; exactly one"),
        ({"body__crank__parent": "rod"}, "make a circle"),
        (
            {"body__rod__axis": [0, 1, 0]},
            "linkage.stroke: crank, coupler and rocker need the same axis",
        ),
        ({"body__rod__parent": "body"}, "the coupler sits on the crank"),
        ({"linkage__stroke__branch": 2}, "1 and -1 are allowed"),
        ({"gear__right": {"follows": "left"}}, "right: moved by more than one"),
        ({"gear": {"left": {"follows": "left"}}}, "left follows left"),
        ({"actuator__left": {"B": 1}}, "left follows another joint; allowed: crank"),
        ({"actuator__crank": {"G": 0}}, "the gear ratio G is zero"),
        ({"spring__tail": {"stiffness": 1}}, "spring: 'tail' is unknown"),
        ({"body__left__inertia": [1e-3, 1e-4, 2e-3]}, "belong to no body"),
        ({"body__left__inertia": [1e-3]}, "three moments of inertia"),
        ({"body__left__axis": [0, 0, 0]}, "axis has no length"),
        ({"body__left__mass": "3 m"}, "m"),
        ({"aerodynamics__tail": {"body": "left", "S": 1}}, "either fits or CL and CD"),
        ({"body__left__weight": 1}, "weight: unknown key"),
    ],
)
def test_faults_are_named(changes, message):
    with pytest.raises(SchemaError) as caught:
        vehicle(**changes)
    assert message in str(caught.value)


def test_a_linkage_that_cannot_close_states_where():
    with pytest.raises(
        SchemaError, match=r"(?s)linkage.stroke.*cannot close at a crank angle of \d+ deg"
    ):
        tree_posture(
            vehicle(linkage__stroke__pin_on_coupler=[0, 0, -0.03]),
            np.linspace(0.0, 6.0, 50)[:, None],
        )


def test_a_file_without_markers_is_refused(tmp_path):
    (tmp_path / "vehicle.toml").write_text(
        '[body.a]\nmass = 1\n[reference]\nS = 1\n[cameras]\nflapping_frequency = "5 Hz"\n',
        encoding="utf-8",
    )
    with pytest.raises(SchemaError, match=r"no body has markers"):
        read_vehicle(tmp_path / "vehicle.toml")
