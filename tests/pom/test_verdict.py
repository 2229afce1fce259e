"""What becomes of each row of the table: judged, advisory, not tested, invalid."""

from dataclasses import replace

import numpy as np
import pytest

from pom import table
from pom.case import Drive, PomCase
from pom.criteria import Band, Limit
from pom.verdict import bands, judge, row, unjudged

TIME = np.arange(0.0, 40.0, 0.02)
DEG = np.pi / 180.0


def case(id, drive=None, **more):
    window = (0.0, 39.9)
    rows = table.rows_of(id)
    criteria = [
        table.criterion(r, name, window, tuple(more.get("features", ())), engine_parameter="engine1.thrust")
        for r, name in zip(rows, table.names_of(rows), strict=True)
    ]
    return PomCase(
        "c", "C", id, table.STANDARD, table.EDITION, "c.toml", "r.nc", window, drive=drive or Drive(), criteria=tuple(criteria), **more
    )


def named(case, name):
    return next(c for c in case.criteria if c.name == name)


def test_every_row_of_the_table_becomes_a_criterion_that_is_judged_or_says_why_not():
    count = {"judged": 0, "not": 0}
    for item in table.rows():
        found = table.criterion(item, "x", (0.0, 1.0), tuple(item["condition"].split(";")), engine_parameter="engine1.thrust")
        assert found.applies
        count["not" if found.reason else "judged"] += 1
        if not found.reason:
            assert found.channel
            assert found.measure in table.JUDGED
    # traces 114, snapshots 53, modes 14, engine 12, trends 8 make 201; 27 of them are on parameters without a house
    # channel: lateral deviation 2, wheel force 5, elevator change 4, trim surfaces 3, spoiler 1, turn rate 1, engine
    # instruments 7, demonstrations and pedal trends 4
    assert count == {"judged": 174, "not": 146}


def test_all_tolerances_of_the_table_are_symmetric():
    for item in table.rows():
        for low, high in (("lower", "upper"), ("alt_lower", "alt_upper")):
            if item[high]:
                assert float(item[low]) == -float(item[high])


def test_a_measure_not_evaluated_is_not_tested_and_never_a_pass():
    c = case("1.c.2")
    got = judge(c, named(c, "climb_rate"), TIME, {"hdot": TIME}, {"hdot": TIME})
    assert (got.verdict, got.note) == ("not_tested", "measure segment_mean is not evaluated yet")


def test_what_drives_a_model_is_not_judged():
    c = case("1.f.1")
    assert unjudged(c, named(c, "ti")) == "engine1.thrust is driven by the record; what drives a model cannot be judged"
    assert unjudged(case("1.f.1", Drive(engine="throttle")), named(c, "ti")) == ""


def test_forces_of_a_model_driven_by_its_surfaces_are_not_judged():
    c = case("2.c.5", features=("reversible_controls",))
    force = next((x for x in c.criteria if x.channel == "F_column"), None) or replace(c.criteria[0], channel="F_column", reason="")
    assert unjudged(c, force) == "the surfaces are driven, so pilot forces have no meaning"


def test_a_channel_that_one_side_lacks_is_not_tested():
    c = case("2.d.6")
    got = judge(c, c.criteria[0], TIME, {"r": TIME}, {"p": TIME})
    assert (got.verdict, got.note) == ("not_tested", "the model has no r")


def test_a_lone_percentage_of_the_range_is_not_tested():
    c = case("2.d.6")
    lone = replace(c.criteria[0], band=Band((Limit("percent", 5.0, "%"),), "single", "range_max"))
    got = judge(c, lone, TIME, {"r": TIME}, {"r": TIME})
    assert got.verdict == "not_tested"
    assert "largest value in service" in got.note


def test_short_data_are_invalid_not_an_exception():
    c = case("2.d.6")
    short = TIME[:1000]
    got = judge(c, c.criteria[0], short, {"r": short}, {"r": short})
    assert got.verdict == "invalid"
    assert got.note.startswith("samples cover 0.00 ... 19.98 s")


def test_spiral_is_judged_at_the_end_and_its_trend_is_advice():
    c = case("2.d.4")
    flight = {"phi": 20.0 * DEG + 0.0 * TIME}
    model = {"phi": 20.0 * DEG + np.where(TIME < 30.0, 10.0 * DEG, 1.0 * DEG)}
    assert judge(c, named(c, "bank_angle"), TIME, flight, model).worst_ratio == pytest.approx(0.5)
    assert judge(c, named(c, "bank_angle trend"), TIME, flight, model).verdict == "advisory"
    assert not named(c, "aileron").applies


def test_rows_are_in_the_unit_of_the_table():
    c = case("2.c.10")
    flight = {"q": 0.0 * TIME}
    found = row("m", named(c, "pitch_rate"), judge(c, named(c, "pitch_rate"), TIME, flight, {"q": flight["q"] + 3.0 * DEG}))
    assert (found["unit"], found["tolerance_text"], found["provenance"]) == ("deg/s", "2 deg/s", "verified")
    assert found["worst"] == pytest.approx(3.0)
    assert found["width"] == pytest.approx(2.0)


def test_bands_are_drawn_inside_their_window_only():
    c = case("2.d.2")
    inside = replace(c.criteria[0], window=(10.0, 20.0))
    c = replace(c, criteria=(inside,))
    width = bands(c, TIME, {"p": 30.0 * DEG * np.ones_like(TIME)})["p"].values
    assert np.isnan(width[TIME < 9.9]).all()
    np.testing.assert_allclose(width[(TIME > 10.1) & (TIME < 19.9)], 3.0 * DEG)  # 10 % of 30 deg/s
