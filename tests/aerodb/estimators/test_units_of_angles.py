"""Tables whose angles have another unit than their column map states, and slopes that disagree."""

import numpy as np
import pandas as pd
import pytest

from aerodb.estimators.coefficient_set import CoefficientSet, EstimateReference, make_numbers
from aerodb.estimators.effects import EstimateTables
from flightmech.errors import SchemaError
from flightmech.units import DEGREE

ALPHA = np.array([-4.0, 0.0, 4.0, 8.0]) * DEGREE


def tables(alpha=ALPHA, deflection=10.0 * DEGREE, moment=0.0):
    """Return the tables of a linear aeroplane; `moment` is added to Cm at 4 deg."""
    rows = []
    for position, angle in enumerate(ALPHA):
        for delta in (0.0, deflection):
            place = {"mach": 0.2, "alpha": alpha[position], "delta_e": delta}
            place |= {"file": "runs.csv", "line": position + 2}
            Cm = 0.05 - angle - (0.2 if delta else 0.0)
            Cm += moment if position == 2 else 0.0
            totals = {"CL": 0.3 + 5.0 * angle, "CD": 0.03, "Cm": Cm}
            for name, value in totals.items():
                rows.append(place | {"coefficient": name, "variable": "", "value": value})
        clean = place | {"delta_e": 0.0, "variable": "alpha"}
        rows.append(clean | {"coefficient": "CL", "value": 5.0})
        rows.append(clean | {"coefficient": "Cm", "value": -1.0})
    one = CoefficientSet(
        "table",
        ("runs.csv",),
        force_axes="stability",
        moment_axes="stability",
        control_axes="stability",
        reference=EstimateReference(16.0, 1.5, 11.0, x=0.0),
        controls=("delta_e",),
        numbers=make_numbers(pd.DataFrame(rows).to_dict("records"), ("delta_e",)),
    )
    return EstimateTables(one, None)


def test_angles_in_their_unit_pass_without_a_remark():
    right = tables()
    assert [effect.name for effect in right.effects()] == ["basic", "elevator"]
    assert right.remarks == []


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"alpha": ALPHA / DEGREE}, "alpha reaches 458.4 deg, at most 180 deg.*stated as rad"),
        ({"deflection": 10.0}, "delta_e reaches 573 deg, at most 90 deg.*stated as rad"),
        ({"alpha": ALPHA * DEGREE}, "alpha is from -0.0698 to 0.14 deg with a lift slope of 286"),
    ],
)
def test_angles_in_another_unit_are_refused(changed, message):
    with pytest.raises(SchemaError, match=message):
        tables(**changed).effects()


def test_a_moment_that_is_not_that_of_its_slope_is_remarked():
    # one total is wrong: the slope changes by 0.1 / 8 deg = 0.72, 14 % of the lift slope
    wrong = tables(moment=0.1)
    wrong.effects()
    (remark,) = wrong.remarks
    assert "slope of the pitching moment that table prints differs by 14 % of the lift" in remark
