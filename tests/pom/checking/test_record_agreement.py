"""A record that disagrees with the others of a report on mass or temperature is named."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from pom.checking.record_agreement import disagreement_remarks
from pom.probing.flight_consistency import LIFT_QUANTITY
from pom.result import make_verdict_table
from pom.tolerances.bands import RowRemark

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture


def flown(record, ratio=1.0, warmth=6.0, **conditions):
    """A result of a record with this lift of flight over model, and air above standard [K]."""
    result = fixture.roll_result()
    case = replace(
        result.case, record=record, aircraft="a.toml", reference="flight", conditions=conditions
    )
    remark = RowRemark("probe", "lift", LIFT_QUANTITY, values={"ratio": ratio, "limit": 0.04})
    rows = [{**row, "remarks": (*row["remarks"], remark)} for row in result.rows]
    air = {**result.conditions, "delta_T": warmth}
    return replace(result, case=case, conditions=air, verdict=make_verdict_table(rows))


HONEST = [flown(f"{k}.nc", 1.02 + 0.001 * k, 6.0 + 0.1 * k) for k in range(3)]


def remarks_of(last):
    *others, found = disagreement_remarks([*HONEST, last])
    assert others == [{}, {}, {}]
    return [item for items in found.values() for item in items]


def test_a_record_like_the_others_has_no_remark():
    assert remarks_of(flown("3.nc", 1.03)) == []


@pytest.mark.parametrize("ratio", [0.97, 1.07])
def test_a_record_with_another_mass_is_a_departure(ratio):
    found = remarks_of(flown("3.nc", ratio))
    assert {item.kind for item in found} == {"departure"}
    assert "3.nc differs" in found[0].text


def test_a_record_with_other_air_is_named():
    found = remarks_of(flown("3.nc", warmth=18.0))
    assert {item.kind for item in found} == {"record_warning"}
    assert "check the temperature" in found[0].text
    # a temperature of the case file is compared with the record elsewhere
    assert remarks_of(flown("3.nc", warmth=18.0, delta_T=18.0)) == []


def test_two_others_are_too_few():
    found = disagreement_remarks([*HONEST[:2], flown("3.nc", 1.2)])
    assert found == [{}, {}, {}]


def test_a_record_counts_once():
    """Three cases of one faulty record do not outvote the others."""
    faulty = [flown("3.nc", 1.1) for _ in range(4)]
    *honest, one, _, _, _ = disagreement_remarks([*HONEST, *faulty])
    assert one
    assert honest == [{}, {}, {}]
