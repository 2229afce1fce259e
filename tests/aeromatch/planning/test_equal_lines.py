"""One problem of many records is one line."""

from aeromatch.planning.steps import join_equal_lines

KEY = "controls.delta_aa: unknown quantity 'delta_aa'; near it: delta_a"


def test_one_wrong_key_of_the_name_map_is_one_line():
    lines = [f"record run_{number}: {KEY}" for number in range(12)]
    other = "case phugoid: the window lies outside the record"
    joined = join_equal_lines([lines[0], other, *lines[1:], lines[3]])
    assert joined == [f"records run_0, run_1, run_2, run_3 and 8 more: {KEY}", other]


def test_lines_without_a_record_stay_and_are_not_repeated():
    lines = ["held: unknown term", "record a: no p", "held: unknown term", "case a: no p"]
    assert join_equal_lines(lines) == ["held: unknown term", "record a: no p", "case a: no p"]
    # another time is another problem
    lines = ["record a: a gap of 2 s (imu)", "record b: a gap of 3 s (imu)"]
    assert join_equal_lines(lines) == lines
