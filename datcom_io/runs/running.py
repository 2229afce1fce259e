"""Running a user's own Digital DATCOM program in a scratch folder and collecting its files.

Builds differ in how they take the deck: from ``for005.dat`` in the folder, from a file whose name
they request on standard input, from a file named on the command line, or from standard input
itself.  All are tried in this order.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from datcom_io.decks.cards import ERROR
from datcom_io.decks.deck_file import DeckFile, deck_text, read_deck
from datcom_io.listing import Listing
from datcom_io.printout.content import ListingMessage
from datcom_io.reading.reader import read
from flightmech.errors import AeromatchError, ParseError, SchemaError, SimulationError
from flightmech.support.atomic_write import written_atomically
from flightmech.support.input_files import file_kind, marked_encoding

_DECK_NAME = "for005.dat"
_PRINTS = (
    "for006.dat",
    "datcom.out",
    "output.dat",
    "fort.6",
)  # unit 6 by the names of known builds, best first
_PLOTS = {"for013": ("for013.dat", "fort.13"), "for014": ("for014.dat", "fort.14")}
_SIGN = b"CONERR - INPUT ERROR CHECKING"
_SHOWN = 300  # characters of the output of a failed program


@dataclass(frozen=True)
class ProgramRun:
    """A run of the program.

    Attributes
    ----------
    listing : Listing
        What it printed, read.
    files : dict of str to Path
        ``out``, and ``for013``, ``for014`` where they were written.
    messages : tuple of Message
        What the program printed on its console, every text once, and (origin ``reader``) what could
        not be read of a complete print and where the echoed cards differ from the deck.
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
    """Run a deck with a user's own Digital DATCOM executable.

    Parameters
    ----------
    deck : path
        Input deck; one with the additions of DATCOM+ is rewritten first as the program reads it.
    program : path, or sequence of str
        Executable, or a command with its first arguments, ``["wine", "datcom.exe"]``.
    folder : path, optional
        Where the results go, under the name of the deck: ``NAME.out``, ``NAME.for013``,
        ``NAME.for014``.  Default: the folder of the deck.
    timeout : float
        Longest time of one attempt. [s]

    Returns
    -------
    Run

    Raises
    ------
    SimulationError
        The program crashed, hung, wrote no print, or the print lacks its end; nothing is written to
        `folder` then.
    OSError
        The program or the deck cannot be opened.

    Notes
    -----
    A run that the program itself stops with a message (NAMELIST INPUT ERROR) is a result: read ``Run.messages``.
    """
    deck = Path(deck)
    folder = Path(folder) if folder is not None else deck.parent
    if not folder.is_dir():
        raise FileNotFoundError(2, "no such folder; make it first", str(folder))
    command = _command(program)
    given_deck = read_deck(deck)
    content = _content(given_deck, deck)
    began = time.monotonic()
    failures: list[str] = []
    for more, given in _ways(content):
        with tempfile.TemporaryDirectory(prefix="datcom") as scratch:
            attempt = _attempt([*command, *more], given, content, Path(scratch), timeout)
            found = _collect(Path(scratch), attempt)
            if found is None:
                failures.append(attempt.failure)
                if attempt.fatal:
                    break
                continue
            if not any(
                f"${name}".encode() in found["out"]
                for case in given_deck
                for name in case.namelists
            ):
                failures.append("it took another input for its deck")
                continue
            listing = _listing(found["out"], attempt)
            files = _keep(found, folder, deck.stem)
            listing.file = files["out"].name
            return ProgramRun(
                listing, files, tuple(_messages(listing, given_deck)), time.monotonic() - began
            )
    raise SimulationError(_refusal(command, failures))


def run_folder(
    folder: str | os.PathLike[str],
    program: str | os.PathLike[str] | Sequence[str],
    results: str | os.PathLike[str] | None = None,
    *,
    timeout: float = 600.0,
) -> Iterator[tuple[Path, ProgramRun | AeromatchError]]:
    """Run every input deck of a folder, such as `split_deck` leaves, one after the other.

    Parameters
    ----------
    folder : path
        Its files with a namelist FLTCON are the decks; others, and folders in it, are left alone.
    program, timeout
        As for `run_deck`; the time is that of one attempt with one deck. [s]
    results : path, optional
        Where the results go, under the names of the decks.  Default: `folder`.

    Yields
    ------
    deck : Path
        The decks by name.
    result : Run or AeromatchError
        What `run_deck` returns, or why it failed; the other decks are run all the same.

    Raises
    ------
    SchemaError
        The folder holds no deck, or decks that differ in their suffix only, whose results would
        have one name.
    OSError
        The program or the folder cannot be opened.
    """
    folder = Path(folder)
    decks = [
        path
        for path in sorted(folder.iterdir())
        if path.is_file() and file_kind(path).startswith("an input deck")
    ]
    stems = Counter(path.stem for path in decks)
    problems = [
        f"several decks are named {stem}; rename all but one"
        for stem, count in stems.items()
        if count > 1
    ]
    if not decks:
        problems.append(
            "no input deck in it (a file with a namelist $FLTCON); make some with datcom split"
        )
    if problems:
        raise SchemaError(str(folder), problems)
    _command(program)
    for deck in decks:
        try:
            yield deck, run_deck(deck, program, results, timeout=timeout)
        except AeromatchError as error:
            yield deck, error


def _command(program: str | os.PathLike[str] | Sequence[str]) -> list[str]:
    words = [os.fspath(program)] if isinstance(program, str | os.PathLike) else list(program)
    found = shutil.which(words[0])
    if found is None:
        there = Path(words[0]).exists()
        raise FileNotFoundError(
            2,
            "not an executable file; make it one" if there else "no such program; give its path",
            words[0],
        )
    return [os.path.abspath(found), *words[1:]]


def _content(deck: DeckFile, path: Path) -> bytes:
    """Return the deck for the program: its own bytes when it is plain."""
    raw = path.read_bytes()
    read_by_the_program = not marked_encoding(raw)[0] and (b"\n" in raw or b"\r" not in raw)
    plain = (
        read_by_the_program
        and not deck.comments
        and not any(finding.severity == ERROR for finding in deck.findings)
    )
    return raw if plain else deck_text(deck).encode("latin-1")


def _ways(content: bytes) -> Iterator[tuple[list[str], bytes]]:
    """Yield further arguments and standard input of each way to hand over the deck."""
    yield [], f"{_DECK_NAME}\n".encode()
    yield [_DECK_NAME], b""
    yield [], content


@dataclass(frozen=True)
class _Attempt:
    """What an attempt ended with; ``failure`` states why when it made no print."""

    output: bytes
    failure: str
    fatal: bool = False  # another way to hand over the deck will not help
    broken: bool = False  # it did not end by itself with success


def _attempt(
    command: list[str], given: bytes, content: bytes, scratch: Path, timeout: float
) -> _Attempt:
    (scratch / _DECK_NAME).write_bytes(content)
    process = subprocess.Popen(
        command,
        cwd=scratch,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=os.name == "posix",
    )
    try:
        output, _ = process.communicate(given, timeout=timeout)
    except subprocess.TimeoutExpired:
        _end(process)
        return _Attempt(
            b"",
            f"it did not end within {timeout:g} s (a deck with VINF and a NACA card hangs "
            f"some builds)",
            fatal=True,
            broken=True,
        )
    words = " ".join(output.decode("latin-1").split())[-_SHOWN:]
    shown = f"; its output: {words}" if words else ""
    if process.returncode < 0:
        return _Attempt(
            output,
            f"it crashed with signal {signal.Signals(-process.returncode).name}{shown}",
            broken=True,
        )
    if process.returncode:
        return _Attempt(output, f"it ended with code {process.returncode}{shown}", broken=True)
    return _Attempt(output, f"it ended without a print of unit 6{shown}")


def _end(process: subprocess.Popen) -> None:
    """Kill a program and what it started."""
    if os.name == "posix":
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.communicate()


def _collect(scratch: Path, attempt: _Attempt) -> dict[str, bytes] | None:
    """Return the files that an attempt made; None without a print."""
    if attempt.fatal:
        return None
    made = {
        path.name.lower(): path
        for path in sorted(scratch.iterdir())
        if path.is_file() and path.name != _DECK_NAME
    }
    ordered = [made[name] for name in _PRINTS if name in made] + [
        path for name, path in made.items() if name not in _PRINTS
    ]
    prints = [
        content
        for content in (*(path.read_bytes() for path in ordered), attempt.output)
        if _SIGN in content
    ]
    if not prints:
        return None
    found = {"out": prints[0]}
    for key, names in _PLOTS.items():
        contents = [made[name].read_bytes() for name in names if name in made]
        if any(content.strip() for content in contents):
            found[key] = next(content for content in contents if content.strip())
    return found


def _listing(content: bytes, attempt: _Attempt) -> Listing:
    """Read a print; one that the program has ended and the reader cannot take whole is kept, with
    the reader's messages.
    """
    ended = b"END OF JOB" in content and not attempt.broken
    try:
        return read(content.decode("latin-1").split("\n"), partial=ended)
    except ParseError as error:
        why = attempt.failure if attempt.broken else str(error) if ended else "it has no END OF JOB"
        raise SimulationError(
            f"the print of the program is not complete: {why}; nothing was written. Run "
            f"datcom check on the deck"
        ) from None


def _messages(listing: Listing, deck: DeckFile) -> Iterator[ListingMessage]:
    """Yield what the program printed on its console, every text once, what the reader left out, and
    where the echo differs.
    """
    texts = {
        message.text: message
        for message in reversed(listing.messages)
        if message.origin == "program"
    }
    yield from sorted(texts.values())
    yield from (message for message in listing.messages if message.text.endswith(": left out"))
    for number, (printed, wanted) in enumerate(zip(listing, deck), 1):
        if printed.deck.meaning() != wanted.meaning():
            yield ListingMessage(
                printed.line,
                f"case {number}: the cards in the print differ from those of the deck",
                "reader",
            )
    if len(listing) != len(deck):
        yield ListingMessage(
            0, f"number of cases: {len(deck)} in the deck, {len(listing)} in the print", "reader"
        )


def _keep(found: dict[str, bytes], folder: Path, stem: str) -> dict[str, Path]:
    files = {key: folder / f"{stem}.{key}" for key in found}
    for key, path in files.items():
        with written_atomically(path) as part:
            part.write_bytes(found[key])
    return files


def _refusal(command: list[str], failures: list[str]) -> str:
    reasons = list(dict.fromkeys(failures))
    tried = (
        ""
        if len(failures) == 1
        else f" (tried with {_DECK_NAME}, its name on standard input and as argument, and the "
        f"deck on standard input)"
    )
    return (
        f"{Path(command[0]).name} made no result{tried}: {'; '.join(reasons)}; nothing was written"
    )
