"""Runs of the Digital DATCOM program of a user, in a scratch folder.

Builds differ in how they read the deck: from ``for005.dat`` in the folder, from a file whose name
they request on standard input, from a file named on the command line, or from standard input
itself.  All ways are tried in this order.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from datcom_io.decks.cards import ERROR, NOTE
from datcom_io.decks.deck_file import DeckFile, deck_text, read_deck
from datcom_io.listing import Listing
from datcom_io.printout.content import ListingMessage
from datcom_io.reading.reader import read
from flightmech.errors import AeromatchError, ParseError, SchemaError, SimulationError
from flightmech.short_text import ShortText
from flightmech.support.atomic_write import folder_for_files, resolve_folder, written_atomically
from flightmech.support.file_kinds import file_kind
from flightmech.support.foreign_code.process import (
    RunLimits,
    describe_exit,
    run_foreign,
    sandbox_for,
)
from flightmech.support.foreign_code.sandbox import read_sandbox_mode
from flightmech.support.input_files import marked_encoding, regular_files

_DECK_NAME = "for005.dat"
# Print file (unit 6) and plot files by the names of known builds, best first.
_PRINTS = ("for006.dat", "datcom.out", "output.dat", "fort.6")
_PLOTS = {"for013": ("for013.dat", "fort.13"), "for014": ("for014.dat", "fort.14")}
# The program begins every run with this line.
_SIGN = b"CONERR - INPUT ERROR CHECKING"
# The program is the user's own, often a script or under wine: it may start processes, and its
# memory is not limited. [byte]
_LIMITS = RunLimits(memory=0, written=1_000_000_000, files=0, processes=True, network=True)
_LARGEST_OUTPUT = 256_000_000
_MOST_OUTPUT = 300  # characters of the output of a failed program in a message
# What the libraries of gfortran and of Intel print above a list of addresses.
_RUNTIME_ERROR = re.compile(r"runtime error|^forrtl:|Program received signal", re.IGNORECASE)


@dataclass(frozen=True)
class ProgramRun(ShortText):
    """A run of the program.

    Attributes
    ----------
    listing : Listing
        Its print, read.
    files : dict of str to Path
        ``out``, and ``for013``, ``for014`` where they were written.
    messages : tuple of Message
        Messages of the program, every text once.  With origin ``reader``: damage of a complete
        print, and cases whose echoed cards differ from the deck.
    seconds : float
        Elapsed time.
    """

    listing: Listing
    files: dict[str, Path]
    messages: tuple[ListingMessage, ...]
    seconds: float


def run_deck(
    deck: str | os.PathLike[str],
    program: str | os.PathLike[str] | Sequence[str],
    folder: str | os.PathLike[str] | None = None,
    *,
    timeout: float = 600.0,
) -> ProgramRun:
    """Run a deck with the Digital DATCOM executable of a user.

    Parameters
    ----------
    deck : path
        Input deck; one with the additions of DATCOM+ is rewritten first as the program reads it.
    program : path, or sequence of str
        Executable, or a command with its first arguments, ``["wine", "datcom.exe"]``.
    folder : path, optional
        Where the results go, under the name of the deck: ``NAME.out``, ``NAME.for013``,
        ``NAME.for014``.  It is made with the results, in an existing folder.  Default: the folder
        of the deck.
    timeout : float
        Longest time of one attempt. [s]

    Returns
    -------
    ProgramRun

    Raises
    ------
    SimulationError
        The program crashed, hung, wrote no print, or the print lacks its end; nothing is written to
        `folder` then.
    OSError
        The program or the deck cannot be opened.

    Notes
    -----
    A run that the program itself stops with a message (NAMELIST INPUT ERROR) is a result: read
    ``ProgramRun.messages``.
    """
    deck = Path(deck)
    folder = Path(folder) if folder is not None else deck.parent
    # A folder that cannot be made is refused before the program runs for minutes.
    if not folder.is_dir():
        resolve_folder(folder)
    # The program is looked up before the deck is read.
    command = _find_command(program)
    cases = read_deck(deck)
    content = _deck_bytes(cases, deck)
    began = time.monotonic()
    outputs, attempt = _run_until_print(command, cases, content, timeout)
    listing = _read_print(outputs["out"], attempt)
    files = _write_files(outputs, folder, deck.stem)
    listing.file = files["out"].name
    messages = tuple(_list_messages(listing, cases))
    return ProgramRun(listing, files, messages, time.monotonic() - began)


def _run_until_print(
    command: list[str], deck: DeckFile, content: bytes, timeout: float
) -> tuple[dict[str, bytes], _Attempt]:
    """Return the files of the first attempt with a print of the deck, and the attempt.

    Raises
    ------
    SimulationError
        No way to pass the deck gives a print of it.
    """
    failures: list[str] = []
    for arguments, standard_input in _ways(content):
        with tempfile.TemporaryDirectory(prefix="datcom") as scratch:
            attempt = _run_program(
                [*command, *arguments],
                standard_input,
                content=content,
                scratch=Path(scratch),
                timeout=timeout,
            )
            outputs = _collect_files(Path(scratch), attempt)
        if outputs is None:
            failures.append(attempt.failure)
            if attempt.fatal:
                break
        elif _echoes_deck(outputs["out"], deck):
            return outputs, attempt
        else:
            failures.append("it took another input for its deck")
    raise SimulationError(_failure_text(command, failures))


def _echoes_deck(content: bytes, deck: DeckFile) -> bool:
    """Return whether a print has a namelist of the deck."""
    names: set[str] = set()
    for case in deck:
        names |= case.namelists.keys()
    return any(f"${name}".encode() in content for name in names)


def run_folder(
    folder: str | os.PathLike[str],
    program: str | os.PathLike[str] | Sequence[str],
    results: str | os.PathLike[str] | None = None,
    *,
    timeout: float = 600.0,
) -> Iterator[tuple[Path, ProgramRun | AeromatchError]]:
    """Run every input deck of a folder, such as those of `split_deck`, one after the other.

    Parameters
    ----------
    folder : path
        Its files with a namelist FLTCON are the decks; other files, and folders, are ignored.
    program, timeout
        As for `run_deck`; the time is that of one attempt with one deck. [s]
    results : path, optional
        Where the results go, under the names of the decks.  Default: `folder`.

    Yields
    ------
    deck : Path
        The decks by name.
    result : ProgramRun or AeromatchError
        The result of `run_deck`, or its error; the other decks are run all the same.

    Raises
    ------
    SchemaError
        The folder holds no deck, or decks that differ in their suffix only, whose results would
        have one name.
    OSError
        The program or the folder cannot be opened.
    """
    folder = Path(folder)
    decks = []
    for path in regular_files(sorted(folder.iterdir()), "an input deck"):
        if file_kind(path).startswith("an input deck"):
            decks.append(path)
    problems = []
    for stem, count in Counter(path.stem for path in decks).items():
        if count > 1:
            problems.append(f"several decks are named {stem}; rename all but one")
    if not decks:
        problems.append(
            "no input deck in it (a file with a namelist $FLTCON); make some with datcom split"
        )
    if problems:
        raise SchemaError(str(folder), problems)
    # A wrong program fails once, not for every deck.
    _find_command(program)
    for deck in decks:
        try:
            yield deck, run_deck(deck, program, results, timeout=timeout)
        except AeromatchError as error:
            yield deck, error


def _find_command(program: str | os.PathLike[str] | Sequence[str]) -> list[str]:
    """Return the command with the absolute path of its executable."""
    if isinstance(program, str | os.PathLike):
        command = [os.fspath(program)]
    else:
        command = list(program)
    executable = shutil.which(command[0])
    if executable is not None:
        return [os.path.abspath(executable), *command[1:]]
    problem = "no such program; give its path"
    if Path(command[0]).exists():
        problem = "not an executable file; make it one"
    raise FileNotFoundError(2, problem, command[0])


def _deck_bytes(deck: DeckFile, path: Path) -> bytes:
    """Return the deck for the program: its own bytes if the parser has changed nothing.

    The parser removes comments, repeats the cards that DATCOM+ repeats (a note), and reports as an
    error what the program does not read.
    """
    raw = path.read_bytes()
    has_mark = bool(marked_encoding(raw)[0])
    has_lone_returns = b"\n" not in raw and b"\r" in raw
    is_changed = any(finding.severity in (ERROR, NOTE) for finding in deck.findings)
    if has_mark or has_lone_returns or deck.comments or is_changed:
        return deck_text(deck).encode("latin-1")
    return raw


def _ways(content: bytes) -> Iterator[tuple[list[str], bytes]]:
    """Yield further arguments and standard input of each way to hand over the deck."""
    yield [], f"{_DECK_NAME}\n".encode()
    yield [_DECK_NAME], b""
    yield [], content


@dataclass(frozen=True)
class _Attempt:
    """Result of an attempt.

    ``failure`` states why it made no print, ``fatal`` that another way to pass the deck does not
    help, ``broken`` that the program did not end by itself with success.
    """

    output: bytes
    failure: str
    fatal: bool = False
    broken: bool = False


def _run_program(
    command: list[str], standard_input: bytes, *, content: bytes, scratch: Path, timeout: float
) -> _Attempt:
    """Run the program in the scratch folder, with the deck in it."""
    (scratch / _DECK_NAME).write_bytes(content)
    done = run_foreign(
        command,
        standard_input,
        timeout=timeout,
        limits=_LIMITS,
        most=_LARGEST_OUTPUT,
        sandbox=sandbox_for(read_sandbox_mode() == "bwrap", [command[0]], str(scratch)),
        cwd=scratch,
        joined=True,
    )
    if done.timed_out:
        return _Attempt(
            b"",
            f"it did not end within {timeout:g} s (a deck with VINF and a NACA card hangs "
            f"some builds)",
            fatal=True,
            broken=True,
        )
    tail = _describe_output(done.output.decode("latin-1"))
    if tail:
        tail = f"; its output: {tail}"
    # A negative code is the number of a signal.
    if done.code < 0:
        return _Attempt(
            done.output, f"it crashed with {describe_exit(done.code)}{tail}", broken=True
        )
    if done.code:
        return _Attempt(done.output, f"it ended with code {done.code}{tail}", broken=True)
    if done.failure:
        return _Attempt(b"", done.failure, fatal=True, broken=True)
    return _Attempt(done.output, f"it ended without a print of unit 6{tail}")


def _describe_output(text: str) -> str:
    """Return what a program printed last, or the error of its runtime library without addresses."""
    lines = [" ".join(line.split()) for line in text.splitlines()]
    for k, line in enumerate(lines):
        if _RUNTIME_ERROR.search(line):
            return " ".join(lines[max(0, k - 1) : k + 1])[-_MOST_OUTPUT:]
    return " ".join(" ".join(lines).split())[-_MOST_OUTPUT:]


def _collect_files(scratch: Path, attempt: _Attempt) -> dict[str, bytes] | None:
    """Return print and plot files of an attempt by their suffix; None without a print."""
    if attempt.fatal:
        return None
    paths = {}
    for path in sorted(scratch.iterdir()):
        if path.is_file() and path.name != _DECK_NAME:
            paths[path.name.lower()] = path
    # Known names of the print first, then all other files, then the console.
    names = [name for name in _PRINTS if name in paths]
    names += [name for name in paths if name not in _PRINTS]
    contents = [paths[name].read_bytes() for name in names]
    contents.append(attempt.output)
    prints = [content for content in contents if _SIGN in content]
    if not prints:
        return None
    outputs = {"out": prints[0]}
    for key, plot_names in _PLOTS.items():
        plots = [paths[name].read_bytes() for name in plot_names if name in paths]
        filled = [content for content in plots if content.strip()]
        if filled:
            outputs[key] = filled[0]
    return outputs


def _read_print(content: bytes, attempt: _Attempt) -> Listing:
    """Read a print.

    Of a print that the program has ended itself, damaged parts are left out and reported.
    """
    has_ended = b"END OF JOB" in content and not attempt.broken
    try:
        return read(content.decode("latin-1").split("\n"), partial=has_ended)
    except ParseError as error:
        reason = "it has no END OF JOB"
        if attempt.broken:
            reason = attempt.failure
        elif has_ended:
            reason = str(error)
        raise SimulationError(
            f"the print of the program is not complete: {reason}; nothing was written. Run "
            f"datcom check on the deck"
        ) from None


def _list_messages(listing: Listing, deck: DeckFile) -> Iterator[ListingMessage]:
    """Yield messages of the program, every text once, and differences of print and deck."""
    first_of_text = {}
    # The last assignment of a text is its first message.
    for message in reversed(listing.messages):
        if message.origin == "program":
            first_of_text[message.text] = message
    yield from sorted(first_of_text.values())
    for message in listing.messages:
        if message.text.endswith(": left out"):
            yield message
    # The echo shows what the program has read.
    for number, (printed, case) in enumerate(zip(listing, deck), 1):
        if printed.deck.meaning() != case.meaning():
            text = f"case {number}: the cards in the print differ from those of the deck"
            yield ListingMessage(printed.line, text, "reader")
    if len(listing) != len(deck):
        text = f"number of cases: {len(deck)} in the deck, {len(listing)} in the print"
        yield ListingMessage(0, text, "reader")


def _write_files(outputs: dict[str, bytes], folder: Path, stem: str) -> dict[str, Path]:
    """Write print and plot files under the name of the deck."""
    names = {key: f"{stem}.{key}" for key in outputs}
    # All contents are on disk before the first file gets its name.
    with folder_for_files(folder) as place, ExitStack() as stack:
        for key, content in outputs.items():
            part = stack.enter_context(written_atomically(place / names[key]))
            part.write_bytes(content)
    return {key: folder / name for key, name in names.items()}


def _failure_text(command: list[str], failures: list[str]) -> str:
    """Return the message about a program without a result; each reason comes once."""
    attempts = ""
    if len(failures) != 1:
        attempts = (
            f" (tried with {_DECK_NAME}, its name on standard input and as argument, and the "
            f"deck on standard input)"
        )
    reasons = "; ".join(dict.fromkeys(failures))
    return f"{Path(command[0]).name} made no result{attempts}: {reasons}; nothing was written"
