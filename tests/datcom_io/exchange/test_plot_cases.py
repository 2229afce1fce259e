"""Which records of a plot file stand for which flight condition.

Files are written here as the program writes them: every number of a part is its ordinal in the case
plus a half.
"""

from pathlib import Path

import numpy as np
import pytest

import datcom_io
from datcom_io.cells import ABSENT, OK
from datcom_io.cli.actions.exchange import plot_file
from datcom_io.exchange.file_types import plot_case
from datcom_io.exchange.plot_files.plot_cases import read_cases
from datcom_io.exchange.plot_files.plot_records import LOGICALS, SIZES
from flightmech.errors import ParseError, SchemaError

LISTINGS = Path(__file__).parents[1] / "listings"
UNUSED = 1e-30
FOOT = 0.3048


def write_record(numbers) -> list[str]:
    texts = [f"{number:12.4E}" for number in numbers]
    return ["".join(texts[k : k + 10]) for k in range(0, len(texts), 10)]


def write_flight(machs, *, loop=1.0, heights=(), ground=0) -> list[str]:
    """Return the record FLC; `ground` is the number of heights over ground, None for no GRNDEF."""
    flight = np.full(160, UNUSED)
    flight[[0, 1, 93, 94, 158, 159]] = len(machs), 2.0, 0.6, 1.4, len(heights), loop
    flight[2 : 2 + len(machs)] = machs
    flight[22:24] = 0.0, 4.0
    flight[96 : 96 + len(heights)] = heights
    if ground:
        flight[62] = ground
        flight[63 : 63 + ground] = 10.0 * np.arange(1, ground + 1)
    return write_record(flight)


def write_part(letter: str, ordinal: int, logicals: str, deflections: int) -> list[str]:
    """Return a heading (H), a static page (P) or a control device (C)."""
    if letter == "H":
        words = "".join(f"  {'T' if word in logicals.split() else 'F'}" for word in LOGICALS)
        return [*write_record(np.ones(19)), *write_record(np.ones(4)), words]
    kind = {"P": "page", "C": "control"}[letter]
    lines = []
    for name, size in SIZES[kind].items():
        numbers = np.full(size, ordinal + 0.5)
        if name == "F":
            numbers[15] = deflections
        lines += write_record(numbers)
    return lines


def write_case(letters: str, logicals: str = "", deflections: int = 1, **flight) -> list[str]:
    lines = write_flight(**flight)
    for ordinal, letter in enumerate(letters, 1):
        lines += write_part(letter, ordinal, f"BO {logicals}", deflections)
    return lines


def read_lines(tmp_path, *cases):
    path = tmp_path / "for013.dat"
    path.write_text("\n".join(line for case in cases for line in case) + "\n")
    return path


# What is written in each condition: letters, switches, deflections, Mach numbers, ground heights.
# Free-air page, control device and pages over ground are counted.
WRITTEN = {
    "plain": ("HP P P", "", 1, [0.3, 0.8, 2.0], 0, [(1, 0, 0)] * 3),
    "flap": ("HPC PC PC", "SYMFP", 3, [0.3, 0.8, 2.0], 0, [(1, 1, 0)] * 3),
    "trim": ("HPC P P", "TRIMC HTPL", 1, [0.3, 0.8, 2.0], 0, [(1, 1, 0), (1, 0, 0), (1, 0, 0)]),
    "trim without tail": ("HP P", "TRIMC", 1, [0.3, 0.8], 0, [(1, 0, 0)] * 2),
    "engines": ("HP P", "JETPOW", 1, [0.3, 2.0, 0.8], 0, [(1, 0, 0), (0, 0, 0), (1, 0, 0)]),
    "ground": ("HPHPHP P", "", 1, [0.3, 0.8, 2.0], 2, [(1, 0, 2), (1, 0, 0), (0, 0, 0)]),
    "ground and ailerons": (
        "HPCHPHPHPHP C PCPPPP",
        "ASYFP",
        2,
        [0.3, 2.0, 0.4],
        2,
        [(1, 1, 4), (0, 1, 0), (1, 1, 4)],
    ),
    "ground and hypersonic flap": (
        "HPHPHPHP PPPP",
        "HYPEF HYPERS",
        1,
        [0.3, 7.0, 0.4],
        1,
        [(1, 0, 3), (0, 0, 0), (1, 0, 3)],
    ),
    "no page at first": ("P PPP", "", 1, [2.0, 0.8, 0.4], 2, [(0, 0, 0), (1, 0, 0), (1, 0, 2)]),
    "control alone": ("C C", "", 1, [7.0, 9.0], 1, [(0, 1, 0), (0, 1, 0)]),
    "low aspect ratio": ("HP", "LOASRT SYMFP", 1, [0.3, 0.8], 0, [(1, 0, 0), (0, 0, 0)]),
    "transverse jet": ("", "", 1, [12.0], 0, [(0, 0, 0)]),
}


@pytest.mark.nightly
@pytest.mark.parametrize("name", WRITTEN)
def test_parts_of_each_condition(name, tmp_path):
    letters, logicals, deflections, machs, ground, wanted = WRITTEN[name]
    case = write_case(letters.replace(" ", ""), logicals, deflections, machs=machs, ground=ground)
    # The case stands before another one, so its end is not that of the file.
    last = write_case("HP", machs=[0.5])
    found = read_cases(read_lines(tmp_path, case, last))
    assert len(found) == 2
    conditions = found[0].conditions
    counts = [(bool(c.page), bool(c.control), len(c.ground)) for c in conditions]
    assert counts == wanted
    assert [c.scheduled.mach for c in conditions] == machs
    # Ordinals in the file are those in the order of the conditions.
    ordinals = []
    for condition in conditions:
        for part in (condition.page, condition.control, *condition.ground):
            if part:
                ordinals.append(part.get("CDO", part.get("VT_CONTROL")).values[0] - 0.5)
    places = [place for place, letter in enumerate(letters.replace(" ", ""), 1) if letter in "PC"]
    assert ordinals == places


@pytest.mark.parametrize(
    ("loop", "wanted"),
    [
        (1.0, [(0.3, 0.0), (0.8, 5000.0)]),
        (2.0, [(0.3, 0.0), (0.8, 0.0), (0.3, 5000.0), (0.8, 5000.0)]),
        (3.0, [(0.3, 0.0), (0.3, 5000.0), (0.8, 0.0), (0.8, 5000.0)]),
    ],
)
def test_order_of_the_run(loop, wanted, tmp_path):
    letters = "HP" + "P" * (len(wanted) - 1)
    case = write_case(letters, machs=[0.3, 0.8], heights=[0.0, 5000.0], loop=loop)
    static = datcom_io.exchange.read_plot(read_lines(tmp_path, case))["case 1/static"]
    np.testing.assert_allclose(static["mach"], [mach for mach, _ in wanted])
    np.testing.assert_allclose(static["h"], [height * FOOT for _, height in wanted])
    np.testing.assert_allclose(static["CD"][0, :, 0], 2.5 + np.arange(len(wanted)))


def test_a_condition_without_page_is_absent(tmp_path):
    case = write_case("HPP", "PRPOWR", machs=[0.3, 2.0, 0.8])
    static = datcom_io.exchange.read_plot(read_lines(tmp_path, case))["case 1/static"]
    assert static["CD_flag"].values[0, :, 0].tolist() == [OK, ABSENT, OK]
    np.testing.assert_array_equal(static["CD"].values[0, :, 0], [2.5, np.nan, 3.5])
    assert static["line"].values.tolist() == [21, 0, 253]


MISPLACED = {
    "a page is missing": ("HP", "", "found the end of the case as part 3 .* a static page"),
    "a page is too many": (
        "HPPP",
        "",
        "line 485: found a static page as part 4 of the case at line 1",
    ),
    "a device is missing": ("HPP", "SYMFP", "line 253: found a static page .* a control device"),
    "a device is too many": ("HPCP", "", "line 253: found a control device .* a static page"),
    "a heading is too many": ("HPHP", "", "line 253: found a heading as part 3"),
    "a device comes first": ("CHPP", "SYMFP", "line 17: found a control device as part 1"),
}


@pytest.mark.parametrize("name", MISPLACED)
def test_parts_that_the_switches_do_not_allow(name, tmp_path):
    letters, logicals, message = MISPLACED[name]
    case = write_case(letters, logicals, machs=[0.3, 0.8])
    last = write_case("HP", machs=[0.5])
    with pytest.raises(ParseError, match=message):
        read_cases(read_lines(tmp_path, case, last))


def test_a_file_that_ends_behind_a_condition(tmp_path):
    case = write_case("HPP", machs=[0.3, 0.8, 2.0])
    tree = datcom_io.exchange.read_plot(read_lines(tmp_path, case))["case 1"]
    assert "behind 2 of 3 flight conditions" in tree.attrs["messages"]
    assert tree["static"]["CD_flag"].values[0, :, 0].tolist() == [OK, OK, ABSENT]


@pytest.mark.nightly
@pytest.mark.parametrize("shape", ["deleted", "doubled", "cut"])
def test_damaged_lines_are_parse_errors(shape, tmp_path):
    """Every tenth line of a file with all kinds of records, and of one without logicals."""
    whole = [
        *write_case("HPCHPHP", "SYMFP", 2, machs=[0.3], ground=1),
        *write_case("CPC", machs=[2.0, 0.8], ground=1),
    ]
    read_cases(read_lines(tmp_path, whole))
    for place in range(3, len(whole) - 1, 10):
        damaged = {
            "deleted": [*whole[:place], *whole[place + 1 :]],
            "doubled": [*whole[: place + 1], *whole[place:]],
            "cut": whole[:place],
        }[shape]
        with pytest.raises(ParseError):
            read_cases(read_lines(tmp_path, damaged))


def test_mach_numbers_of_speeds():
    """The program computes them behind the record: V / (49.01685 sqrt(T)) in feet and degrees
    Rankine, 518.69 and 500.84 degR here.
    """
    tree = datcom_io.exchange.read_plot(LISTINGS / "speeds.for013")["case 1"]
    np.testing.assert_allclose(tree["static"]["mach"], [1.102, 0.4558], rtol=1e-3)
    case = datcom_io.read(LISTINGS / "speeds.out")[0].to_datatree()
    fine = datcom_io.exchange.refine(case, tree)
    assert fine["static"]["CL"].attrs["refined"].startswith("5 of 12")
    # A print without the first condition takes the numbers of the second one.
    second = case.copy(deep=True)
    second["static"] = second["static"].to_dataset().isel(condition=[1])
    for name in ("auxiliary", "planform"):
        del second[name]
    finer = datcom_io.exchange.refine(second, tree)["static"]
    np.testing.assert_array_equal(finer["CL"][:, 0], fine["static"]["CL"][:, 1])
    wrong = second.copy(deep=True)
    wrong["static"] = wrong["static"].to_dataset().assign_coords(mach=("condition", [0.457]))
    with pytest.raises(SchemaError, match=r"mach is 0\.457 in the print"):
        datcom_io.exchange.refine(wrong, tree)


def test_no_page_in_the_first_condition(capsys):
    """Supersonic with ground heights: the pages of the second condition have no logicals."""
    file, listing = LISTINGS / "no_first_page.for013", LISTINGS / "no_first_page.out"
    conditions = read_cases(file)[0].conditions
    assert [(bool(c.page), len(c.ground), c.line) for c in conditions] == [(0, 0, 0), (1, 1, 17)]
    records = datcom_io.exchange.read_plot(file)["case 1/records"]
    assert records["BODY_flag"].values[:, 0].tolist() == [ABSENT, OK]
    plot_file(str(file), str(listing), None, False)
    assert "nothing is refined: line 1: no static page in the first condition" in (
        capsys.readouterr().out
    )


def test_hypersonic_control_without_page():
    cases = read_cases(LISTINGS / "hypersonic_tail_flap.for013")
    (condition,) = cases[0].conditions
    assert not condition.page
    assert condition.control["F"].line == 17


def test_cases_that_the_program_did_not_compute(capsys):
    """Of three cases the first is refused and not in the file, the second is aborted and in it."""
    tree = datcom_io.exchange.read_plot(LISTINGS / "aborted.for013")
    listing = datcom_io.read(LISTINGS / "aborted.out")
    places = [plot_case(listing, case, tree) for case in listing]
    assert [place and place.name for place in places] == [None, "case 1", "case 2"]
    plot_file(str(LISTINGS / "aborted.for013"), str(LISTINGS / "aborted.out"), None, False)
    assert capsys.readouterr().out.count("2 of 2 numbers") == 10


def test_a_plot_file_without_angles_refines_nothing():
    """A deck without ALSCHD prints a row of no angle, and its plot file has no point."""
    case = datcom_io.read(LISTINGS / "speeds.out")[0].to_datatree()
    tree = datcom_io.exchange.read_plot(LISTINGS / "speeds.for013")["case 1"]
    empty = tree.copy()
    empty["static"] = tree["static"].isel(alpha=slice(0, 0))
    fine = datcom_io.exchange.refine(case, empty)
    assert fine["static"].to_dataset().identical(case["static"].to_dataset())


@pytest.mark.slow
def test_numbers_that_power_has_rounded_stay_as_printed():
    """The sum with power overflows the print; its rounding stays in the plot file, which has CD
    1/1024 off.
    """
    tree = datcom_io.read(LISTINGS / "tiny_propeller.out")[0].to_datatree()
    plot = datcom_io.exchange.read_plot(LISTINGS / "tiny_propeller.for013")["case 1"]
    fine = datcom_io.exchange.refine(tree, plot)
    body, whole = ({"configuration": k, "condition": 0, "power": 0} for k in (0, 2))
    printed, written = tree["static"]["CD"], plot["static"]["CD"]
    np.testing.assert_array_equal(fine["static"]["CD"][whole], printed[whole])
    where = {"configuration": 2, "condition": 0}
    assert np.abs(written[where].values - printed[whole].values).max() > 5e-4
    assert not np.array_equal(fine["static"]["CD"][body], printed[body])
