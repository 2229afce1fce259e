"""One aeroplane in stability axes and in body axes, by closed form, gives one database."""

import sys
from pathlib import Path

import numpy as np
import pytest

import aerodb
from aerodb.estimators.build import build_database
from aerodb.estimators.coefficient_set import CoefficientSet, EstimateReference, make_numbers
from aerodb.prior.prior_errors import errors_with
from flightmech.units import DEGREE

sys.path.insert(0, str(Path(__file__).parent))
from light_aircraft import FOOT, aircraft

# Rolling and yawing moment by sideslip, and by roll and yaw rate, in stability axes.
SIDESLIP = np.array([-0.09, 0.06])
RATES = np.array([[-0.5, 0.1], [-0.03, -0.1]])


def rows_of(alpha, line):
    """Return the numbers of one incidence in stability axes and in body axes."""
    cos, sin = np.cos(alpha), np.sin(alpha)
    lift = 0.3 + 5.0 * alpha
    drag, moment = 0.03 + 0.05 * lift**2, 0.05 - alpha
    body = np.array([[cos, -sin], [sin, cos]])  # from stability axes, of (roll, yaw)
    stability_rows = {("CL", ""): lift, ("CD", ""): drag, ("CL", "qhat"): 6.0}
    body_rows = {
        ("CX", ""): lift * sin - drag * cos,
        ("CZ", ""): -lift * cos - drag * sin,
        ("CX", "qhat"): 6.0 * sin,
        ("CZ", "qhat"): -6.0 * cos,
    }
    both = ((stability_rows, np.eye(2)), (body_rows, body))
    for rows, turn in both:
        rows |= {("Cm", ""): moment, ("Cm", "qhat"): -15.0}
        # The axes of the rates turn with those of the moments.
        columns = {"beta": turn @ SIDESLIP}
        columns |= dict(zip(("phat", "rhat"), (turn @ RATES @ turn.T).T))
        for variable, column in columns.items():
            rows |= {("Cl", variable): column[0], ("Cn", variable): column[1]}
    place = {"mach": 0.2, "alpha": alpha, "file": "a", "line": line}
    found = []
    for rows, _ in both:
        found.append(
            [place | {"coefficient": c, "variable": v, "value": x} for (c, v), x in rows.items()]
        )
    return found


def stability_axes(rows):
    """Return a set of numbers in stability axes."""
    return CoefficientSet(
        "table",
        ("a",),
        force_axes="stability",
        moment_axes="stability",
        control_axes="stability",
        reference=EstimateReference(aircraft().S, aircraft().cbar, aircraft().b, 7.6 * FOOT),
        controls=(),
        numbers=make_numbers(rows, ()),
        unit_stated=True,
    )


@pytest.mark.filterwarnings("ignore::flightmech.errors.AeromatchWarning")
def test_roll_derivatives_alone_are_turned_to_body_axes():
    """A program without yaw derivatives: they count as zero, and the axes turn all the same."""
    alphas = np.array([-4.0, 0.0, 6.0, 12.0]) * DEGREE
    rows = []
    for line, alpha in enumerate(alphas, 1):
        rows += [row for row in rows_of(alpha, line)[0] if row["variable"] != "rhat"]
    leaves = aerodb.terms(
        build_database(aircraft(), stability_axes(rows), errors=errors_with(None))
    )
    cos, sin = np.cos(alphas[3]), np.sin(alphas[3])
    damping = RATES[0, 0] * cos**2 - RATES[1, 0] * sin * cos
    assert leaves["Cl/phat"]["value"].values[0, 3] == pytest.approx(damping, rel=1e-8)
    assert "Cl/rhat" not in leaves


@pytest.mark.filterwarnings("ignore::flightmech.errors.AeromatchWarning")
def test_body_axes_give_the_database_of_stability_axes():
    alphas = np.array([-4.0, 0.0, 6.0, 12.0]) * DEGREE
    databases = []
    for position, axes in enumerate(("stability", "body")):
        rows = []
        for line, alpha in enumerate(alphas, 1):
            rows += rows_of(alpha, line)[position]
        one = CoefficientSet(
            "table",
            ("a",),
            force_axes=axes,
            moment_axes=axes,
            control_axes=axes,
            reference=EstimateReference(aircraft().S, aircraft().cbar, aircraft().b, 7.6 * FOOT),
            controls=(),
            numbers=make_numbers(rows, ()),
            unit_stated=True,
        )
        tree = build_database(aircraft(), one, errors=errors_with(None))
        databases.append(aerodb.terms(tree))
    first, second = databases
    assert first.keys() == second.keys()
    assert {"CL/qhat", "Cl/phat", "Cn/phat", "Cl/rhat", "Cn/rhat", "Cn/beta"} <= first.keys()
    for name, leaf in first.items():
        for key in ("value", "stderr"):
            expected = leaf[key].values
            assert second[name][key].values == pytest.approx(expected, rel=1e-8, abs=1e-10)
    # At 12 deg the roll damping in body axes is not that in stability axes.
    cos, sin = np.cos(alphas[3]), np.sin(alphas[3])
    damping = RATES[0, 0] * cos**2 + RATES[1, 1] * sin**2 - (RATES[0, 1] + RATES[1, 0]) * sin * cos
    assert first["Cl/phat"]["value"].values[0, 3] == pytest.approx(damping, rel=1e-8)
