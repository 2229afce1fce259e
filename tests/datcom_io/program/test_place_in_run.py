"""What a run prints depends on its place in the run only where cells are flagged: runs of the
program itself.
"""

import itertools

import numpy as np
import pytest

import datcom_io
from datcom_io.cells import SUSPECT

HEAD = "DIM M\nDERIV DEG\nDAMP\n"
CASES = {
    "clean": ("flight", "body", "wing", "tail"),
    "elevator": ("flight", "body", "wing", "tail", "elevator"),
    "ailerons": ("flight", "body", "wing", "ailerons"),
    "ground": ("flight", "body", "wing", "tail", "ground"),
    "jet": ("flight", "body", "wing", "tail", "jet power"),
    "elevator over ground": ("flight", "body", "wing", "tail", "elevator", "ground"),
}
LAST_DIGIT = ("D(CDI)", "D(CD MIN)")  # hold D(CM) in the last printed digit


def case(parts, name):
    return (
        HEAD + "".join(parts[part] for part in CASES[name]) + f"CASEID {name.upper()}\nNEXT CASE\n"
    )


def differing(case, alone):
    """Return the columns in which cells that are not suspect differ from those of the same case
    alone.
    """
    found = set()
    items = [[item for page in one.pages for item in page.tables] for one in (case, alone)]
    assert [item.name for item in items[0]] == [item.name for item in items[1]]
    for table, other in zip(*items):
        changed = ~np.isclose(table.values, other.values, rtol=0.0, atol=0.0, equal_nan=True) & (
            table.flags != SUSPECT
        )
        names = [table.columns[k].name for k in np.flatnonzero(changed.any(axis=0))]
        found |= {
            name
            for name in names
            if not (
                name in LAST_DIGIT
                and np.allclose(table.values, other.values, atol=2e-4, equal_nan=True)
            )
        }
    return found


@pytest.mark.nightly
def test_a_case_behind_any_other_prints_what_it_prints_alone(run, parts):
    alone = {name: run(case(parts, name), name=name.replace(" ", "_")).listing[0] for name in CASES}
    for number, (first, second) in enumerate(itertools.product(CASES, CASES)):
        listing = run(case(parts, first), case(parts, second), name=f"pair_{number}").listing
        assert differing(listing[1], alone[second]) == set(), (first, second)


@pytest.mark.slow
def test_deflections_alone_and_in_a_list(run, parts):
    """Only D(CM) of the later ones differs, and that is flagged."""
    together = next(table for _, table in run(case(parts, "elevator")).listing[0].tables("symflp"))
    for i, delta in enumerate(("-20.0", "0.0", "10.0")):
        parts_of_one = {
            **parts,
            "elevator": parts["elevator"].replace(
                "NDELTA=3.0,DELTA(1)=-20.0,0.0,10.0", f"NDELTA=1.0,DELTA(1)={delta}"
            ),
        }
        one = next(
            table
            for _, table in run(case(parts_of_one, "elevator"), name=f"one_{i}")
            .listing[0]
            .tables("symflp")
        )
        equal = np.isclose(one.values[0], together.values[i], rtol=0.0, atol=0.0, equal_nan=True)
        changed = [
            column.name
            for column, same in zip(one.columns, equal)
            if not same and column.name != "(CH)A"
        ]  # printed once
        assert set(changed) <= {"D(CM)"}
        assert (together.flags[i] == SUSPECT).sum() == (i > 0)
        assert not (one.flags == SUSPECT).any()


@pytest.mark.slow
def test_a_study_split_and_run_in_a_folder_is_put_together(program, parts, tmp_path):
    """No number is suspect, and every deflection is that of its own run."""
    study = (
        HEAD
        + "".join(parts[part] for part in CASES["elevator over ground"])
        + "CASEID STUDY\nNEXT CASE\n"
    )
    decks = datcom_io.split_deck(datcom_io.read_deck(study.split("\n")))
    assert list(decks) == ["clean", "elevator_d-20", "elevator_d0", "elevator_d10", "ground"]
    for deck in decks.values():
        datcom_io.write_deck(deck, tmp_path / deck.file)
    runs = {path.stem: done.listing[0] for path, done in datcom_io.run_folder(tmp_path, program)}
    single = [runs[name] for name in decks if name.startswith("elevator")]
    leaf = datcom_io.join(one.to_datatree() for one in single)["symflp"]
    np.testing.assert_allclose(leaf["delta"], np.radians([-20.0, 0.0, 10.0]))
    assert not (leaf["dCm_flag"] == SUSPECT).any()
    printed = [next(table for _, table in one.tables("symflp")).values[0, 2] for one in single]
    assert leaf["dCm"].values[0].tolist() == printed


@pytest.mark.slow
@pytest.mark.parametrize(
    ("angles", "right"), [("-4.0,0.0,4.0,8.0,12.0", False), ("-12.0,-8.0,-6.0,-4.0,-2.0", True)]
)
def test_rows_of_missing_angles(run, parts, angles, right):
    """With NALPHA one too large CL of the other rows is that of NALPHA=5 only where all angles are
    below zero.
    """
    five = {**parts, "flight": parts["flight"].replace("-4.0,0.0,4.0,8.0,12.0", angles)}
    six = {**five, "flight": five["flight"].replace("NALPHA=5.0", "NALPHA=6.0")}
    good, odd = (
        next(table for _, table in run(case(given, "clean"), name=name).listing[0].tables("static"))
        for name, given in (("five", five), ("six", six))
    )
    assert len(odd.rows) == 6
    assert np.allclose(odd.values[:5, 2], good.values[:, 2], atol=5e-4) is right
    assert bool((odd.flags[:5, 2] == SUSPECT).all()) is not right
    assert (odd.flags[5, 1:3] == SUSPECT).all()
