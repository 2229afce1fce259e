"""Fake programs that copy a shipped listing, hang, crash or write nothing, as builds of the program
do.
"""

import errno
import sys
import textwrap
from pathlib import Path

import pytest

import datcom_io
from datcom_io.runs import running
from flightmech.errors import SchemaError, SimulationError

T37 = Path(__file__).parents[3] / "data" / "t37" / "datcom"
LISTING = T37 / "t37_aileron.out"
HEAD = f"""\
#!{sys.executable}
import os, pathlib, signal, sys, time
LISTING = pathlib.Path({str(LISTING)!r}).read_bytes()
"""
# how builds take the deck and where they print
BUILDS = {
    "fixed names": """
        assert "ASYFLP" in open("for005.dat").read()
        open("for006.dat", "wb").write(LISTING)
        open("for013.dat", "w").write("1.0\\n")
        open("for014.dat", "w").write("")
        open("scratch.tmp", "w").write("x")
        """,
    "requires the name": """
        assert "ASYFLP" in open(input("Enter the name of the input file: ")).read()
        open("datcom.out", "wb").write(LISTING)
        """,
    "name as argument": """
        if len(sys.argv) != 2:
            print("usage: datcom input.dat")
            sys.exit()
        assert "ASYFLP" in open(sys.argv[1]).read()
        open("output.dat", "wb").write(LISTING)
        """,
    "deck on standard input": """
        deck = sys.stdin.read()
        echo = b"1          THE FOLLOWING IS A LIST OF ALL INPUT CARDS FOR THIS CASE.\\n0\\n for005.dat\\n"
        refused = echo + b" ERROR IN CARD BELOW\\n for005.dat\\n"
        text = LISTING if "ASYFLP" in deck else b"".join(LISTING.splitlines(True)[20:32]) + refused
        sys.stdout.buffer.write(text)
        """,
    "ends with a code": """
        open("for006.dat", "wb").write(LISTING)
        sys.exit(7)
        """,
}


@pytest.fixture
def program(tmp_path):
    def make(body):
        path = tmp_path / "datcom"
        path.write_text(HEAD + textwrap.dedent(body))
        path.chmod(0o755)
        return path

    return make


@pytest.fixture
def deck(tmp_path):
    path = tmp_path / "aileron.inp"
    path.write_bytes((T37 / "t37_aileron.inp").read_bytes())
    return path


@pytest.fixture
def results(tmp_path):
    folder = tmp_path / "results"
    folder.mkdir()
    return folder


@pytest.mark.nightly
@pytest.mark.parametrize("build", BUILDS)
def test_every_known_way_to_hand_over_a_deck(build, program, deck, results):
    done = datcom_io.run_deck(deck, program(BUILDS[build]), results, timeout=600)
    assert done.listing.case_names == ["T-37 OWN DECK WING-BODY AILERONS"]
    assert done.listing.file == "aileron.out"
    assert done.messages == ()
    assert done.files["out"] == results / "aileron.out"
    assert done.files["out"].read_bytes() == LISTING.read_bytes()
    assert sorted(path.name for path in results.iterdir()) == sorted(
        path.name for path in done.files.values()
    )
    assert ("for013" in done.files) == (build == "fixed names")


def test_results_go_next_to_the_deck(program, deck):
    assert datcom_io.run_deck(deck, program(BUILDS["fixed names"])).files[
        "for013"
    ] == deck.with_suffix(".for013")


def test_a_command_with_arguments(program, deck, results):
    path = program(BUILDS["fixed names"])
    assert datcom_io.run_deck(deck, [sys.executable, str(path)], results).listing.case_names


def test_a_datcom_plus_deck_is_rewritten_first(program, deck, results):
    plain = deck.read_text()
    deck.write_text("* THE AILERON\n" + plain.replace("NALPHA=19.0,", "NALPHA=19.0, ! many\n  "))
    body = "assert '!' not in open('for005.dat').read()\n" + textwrap.dedent(BUILDS["fixed names"])
    assert datcom_io.run_deck(deck, program(body), results).listing.case_names


def test_a_complete_print_is_kept_when_the_reader_cannot_take_all_of_it(program, deck, results):
    """The last row of a table is lost; the program itself came to END OF JOB."""
    row = next(line for line in LISTING.read_text().split("\n") if line.startswith("   20.0    0."))
    body = f"""
        open("for006.dat", "wb").write(LISTING.replace({row.encode()!r} + b"\\n", b"", 1))
        """
    done = datcom_io.run_deck(deck, program(body), results)
    assert done.files["out"].read_text().count(row) == LISTING.read_text().count(row) - 1
    assert any(
        "18 rows in the static table instead of 19 rows" in message.text
        for message in done.listing.messages
    )
    assert any("18 rows in the static table" in message.text for message in done.messages)


def test_a_print_with_an_angle_that_the_cards_do_not_give(program, deck, results):
    source = Path(__file__).parents[1] / "listings" / "missing_angle.out"
    done = datcom_io.run_deck(
        deck,
        program(f'open("for006.dat", "wb").write(pathlib.Path({str(source)!r}).read_bytes())'),
        results,
    )
    assert done.files["out"].read_bytes() == source.read_bytes()


FAILURES = {
    "writes nothing": (
        "",
        r"datcom made no result \(tried with for005.dat.*: it ended without a print of unit "
        r"6; nothing was written",
    ),
    "states why": (
        'print("no licence"); sys.exit(3)',
        "it ended with code 3; its output: no licence; nothing was written",
    ),
    "names the error of its library": (
        'print("At line 7 (unit = 9)\\nFortran runtime error: End of file\\n#0 0x55 in ???"); '
        "sys.exit(2)",
        r"its output: At line 7 \(unit = 9\) Fortran runtime error: End of file; nothing",
    ),
    "crashes at once": (
        "os.kill(os.getpid(), signal.SIGSEGV)",
        "it crashed with signal SIGSEGV; nothing was written",
    ),
    "crashes in the print": (
        'open("for006.dat", "wb").write(LISTING[:9000]); os.kill(os.getpid(), signal.SIGSEGV)',
        "the print of the program is not complete: it crashed with signal SIGSEGV; nothing "
        "was written. Run datcom check",
    ),
    "print without its end": (
        'open("for006.dat", "wb").write(LISTING[:9000])',
        "the print of the program is not complete: it has no END OF JOB; nothing was written",
    ),
    "hangs": (
        "time.sleep(60)",
        r"it did not end within 0.5 s \(a deck with VINF and a NACA card hangs some "
        r"builds\); nothing was written",
    ),
    "hangs with a child": (
        "if os.fork() == 0:\n    time.sleep(60)\ntime.sleep(60)",
        "it did not end within 0.5 s",
    ),
}


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform == "win32", reason="signals and forks are of POSIX")
@pytest.mark.parametrize("failure", FAILURES)
def test_a_failure_is_clear_and_leaves_nothing(failure, program, deck, results):
    body, words = FAILURES[failure]
    (results / "aileron.out").write_text("old")
    with pytest.raises(SimulationError, match=words):
        datcom_io.run_deck(deck, program(body), results, timeout=0.5 if "hangs" in failure else 600)
    assert [path.name for path in results.iterdir()] == ["aileron.out"]
    assert (results / "aileron.out").read_text() == "old"


def test_what_the_program_states_is_reported_once(program, results):
    body = f"open('for006.dat', 'wb').write(open({str(T37 / 't37_flaps.out')!r}, 'rb').read())"
    done = datcom_io.run_deck(T37 / "t37_flaps.inp", program(body), results)
    assert sum(message.origin == "program" for message in done.listing.messages) == 3
    assert [message.text.split("***")[0] for message in done.messages] == ["WARNING"]


def test_a_print_of_another_deck_is_reported(program, deck, results):
    deck.write_text(deck.read_text().replace("SREF=182.0", "SREF=183.0") * 2)
    done = datcom_io.run_deck(deck, program(BUILDS["fixed names"]), results)
    assert [message.text for message in done.messages] == [
        "case 1: the cards in the print differ from those of the deck",
        "number of cases: 2 in the deck, 1 in the print",
    ]


def test_a_new_folder_comes_with_its_results(deck, program, tmp_path, monkeypatch):
    done = datcom_io.run_deck(deck, program(BUILDS["fixed names"]), tmp_path / "new")
    assert {path.parent for path in done.files.values()} == {tmp_path / "new"}
    assert sorted((tmp_path / "new").iterdir()) == sorted(done.files.values())

    def fail(part, content):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", fail, raising=True)
    with pytest.raises(OSError, match="not written") as caught:
        running._write_files({"out": b"print"}, tmp_path / "other", "deck")
    assert caught.value.filename == str(tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_what_is_not_there(deck, results, tmp_path):
    with pytest.raises(FileNotFoundError, match="no such program; give its path"):
        datcom_io.run_deck(deck, tmp_path / "nosuch", results)
    (tmp_path / "text").write_text("x")
    with pytest.raises(FileNotFoundError, match="not an executable file"):
        datcom_io.run_deck(deck, tmp_path / "text", results)
    with pytest.raises(FileNotFoundError, match="no such folder; make it first"):
        datcom_io.run_deck(deck, sys.executable, tmp_path / "nowhere" / "results")


@pytest.fixture
def folder(tmp_path):
    """A folder of two decks, with files of other kinds among them."""
    place = tmp_path / "decks"
    (place / "older").mkdir(parents=True)
    for name in ("aileron", "broken"):
        (place / f"{name}.inp").write_text((T37 / "t37_aileron.inp").read_text())
    (place / "notes.txt").write_text("flaps tomorrow")
    (place / "t37_clean.out").write_bytes((T37 / "t37_ground.out").read_bytes())
    return place


@pytest.mark.slow
def test_all_decks_of_a_folder_are_run_whatever_becomes_of_one(program, folder, results):
    text = (folder / "broken.inp").read_text()
    (folder / "broken.inp").write_text(text.replace("CASEID", "CASEID CRASH "))
    body = "assert 'CRASH' not in open('for005.dat').read()\n" + textwrap.dedent(
        BUILDS["fixed names"]
    )
    (aileron, done), (broken, error) = datcom_io.run_folder(folder, program(body), results)
    assert (aileron.name, broken.name) == ("aileron.inp", "broken.inp")
    assert done.files["out"] == results / "aileron.out"
    assert isinstance(error, SimulationError)
    assert sorted(path.name for path in results.iterdir()) == ["aileron.for013", "aileron.out"]


def test_folders_that_cannot_be_run(program, folder, tmp_path):
    path = program(BUILDS["fixed names"])
    with pytest.raises(
        SchemaError, match=r"no input deck in it \(a file with a namelist \$FLTCON\)"
    ):
        next(datcom_io.run_folder(folder / "older", path))
    with pytest.raises(FileNotFoundError, match="no such program"):
        next(datcom_io.run_folder(folder, tmp_path / "missing"))
    (folder / "aileron.dcm").write_text((folder / "aileron.inp").read_text())
    with pytest.raises(SchemaError, match="several decks are named aileron; rename all but one"):
        next(datcom_io.run_folder(folder, path))
