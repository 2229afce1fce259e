"""Rules of the flight conditions: counts, speeds, atmosphere, loops, angles of attack, regimes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

from datcom_io.decks.cards import ERROR, NOTE, WARNING, DeckFinding
from datcom_io.decks.deck import Deck
from datcom_io.decks.namelists import COUNTS, VARIABLES


def check_value_counts(deck: Deck) -> Iterator[DeckFinding]:
    """Yield counts that are missing, not a count, or differ from the values given."""
    # A counter states how many values of its arrays the program uses.
    for name, counter, needed, others in COUNTS:
        group = deck.namelists.get(name, {})
        arrays = [array for array in (*needed, *others) if array in group]
        if not arrays:
            continue
        count = _find_count(deck, name, counter)
        line, most = deck.line_of(name, counter), abs(VARIABLES[name][arrays[0]])
        if count is None:
            yield DeckFinding(
                line,
                ERROR,
                f"${name}: {counter} is not given, {', '.join(arrays)} is; write how many "
                f"values count",
            )
        elif count != int(count) or not 0 < count <= most:
            yield DeckFinding(
                line,
                ERROR,
                f"${name}: {counter}={count:g}; allowed are whole numbers from 1 to {most}",
            )
        else:
            for array in arrays:
                # Without an angle of attack the program still runs.
                severity = WARNING
                if array in needed and array != "ALSCHD":
                    severity = ERROR
                yield from _check_length(
                    deck, name, array=array, counter=counter, count=int(count), severity=severity
                )


def _check_length(
    deck: Deck, name: str, *, array: str, counter: str, count: int, severity: str
) -> Iterator[DeckFinding]:
    """Yield an array that does not have as many values as its counter states."""
    values = deck.namelists[name][array]
    line = deck.line_of(name, array)
    missing = [i + 1 for i, value in enumerate(values[:count]) if value is None]
    if len(values) < count:
        text = (
            f"${name}: {array} has {len(values)} values, {counter}={count:g}; the program takes "
            f"the missing ones as 1E-30"
        )
        if array == "ALSCHD":
            text += (
                ", prints NDM for these angles, and interpolates wrongly at the others "
                "unless all are below zero: correct NALPHA"
            )
        yield DeckFinding(line, severity, text)
    elif missing:
        yield DeckFinding(
            line,
            severity,
            f"${name}: {array} has no value at place {missing[0]}; the program takes it as 1E-30",
        )
    elif len(values) > count:
        yield DeckFinding(
            line,
            NOTE,
            f"${name}: {array} has {len(values)} values, {counter}={count:g}; the rest is not used",
        )


def _find_count(deck: Deck, name: str, counter: str) -> float | None:
    """Return a count; NALT may be missing when Mach number and altitude step together."""
    number = deck.value(name, counter)
    if number is None and counter == "NALT" and deck.loop == 1:
        return deck.value(name, "NMACH")
    return number


def check_flight_conditions(deck: Deck) -> Iterator[DeckFinding]:
    """Yield speeds and loops that make no flight condition."""
    if "FLTCON" not in deck.namelists:
        return
    line = deck.line_of("FLTCON")
    # The page of a transverse jet needs no angle of attack.
    if not deck.values("FLTCON", "ALSCHD") and "TRNJET" not in deck.namelists:
        yield DeckFinding(
            line,
            ERROR,
            "$FLTCON: no angles of attack, so the tables have no row with a number; write "
            "NALPHA and ALSCHD(1)=...",
        )
    if deck.value("FLTCON", "MACH") is None and deck.value("FLTCON", "VINF") is None:
        yield DeckFinding(
            line, ERROR, "$FLTCON: no speed, neither MACH nor VINF; the program leaves the case out"
        )
    loop = deck.value("FLTCON", "LOOP")
    # The default is 1.
    if loop not in (None, 1.0, 2.0, 3.0):
        yield DeckFinding(
            deck.line_of("FLTCON", "LOOP"),
            WARNING,
            f"$FLTCON: LOOP={loop:g}; allowed are 1, 2, 3, the program takes the nearest",
        )
    if deck.loop > 1 and deck.value("FLTCON", "NALT") is None and _has_atmosphere(deck):
        yield DeckFinding(
            line,
            ERROR,
            f"$FLTCON: LOOP={deck.loop} and no NALT, so there is no flight condition; write NALT",
        )


def _is_given(deck: Deck, name: str) -> bool:
    """Return whether a variable of FLTCON has a value."""
    return deck.value("FLTCON", name) is not None


def _has_atmosphere(deck: Deck) -> bool:
    """Return whether altitude, or pressure and temperature, are given."""
    has_pressure = _is_given(deck, "PINF") and _is_given(deck, "TINF")
    return has_pressure or _is_given(deck, "ALT")


def check_atmosphere(deck: Deck) -> Iterator[DeckFinding]:
    """Yield combinations of speed, atmosphere and Reynolds number that the program completes."""
    if "FLTCON" not in deck.namelists:
        return
    mach, speed = _is_given(deck, "MACH"), _is_given(deck, "VINF")
    reynolds = _is_given(deck, "RNNUB")
    # The program completes what is missing, with an error or a warning.
    air = _has_atmosphere(deck)
    line = deck.line_of("FLTCON")
    if not air and not reynolds:
        text = (
            "$FLTCON: neither altitude nor PINF with TINF nor RNNUB; the program takes the "
            "Reynolds number 5E6 per unit length"
        )
        yield DeckFinding(line, ERROR, f"{text} and prints ERROR: write ALT")
    if not air and speed and not mach:
        yield DeckFinding(
            line,
            ERROR,
            "$FLTCON: VINF without atmosphere; the program takes 1000 ft/s as speed of "
            "sound: write ALT or MACH",
        )
    if mach and speed:
        yield DeckFinding(
            deck.line_of("FLTCON", "VINF"),
            WARNING,
            "$FLTCON: MACH and VINF; the program uses MACH and overwrites VINF: write one",
        )
    if speed and not mach and deck.sections:
        text = "VINF with a NACA card: some builds hang; write MACH, or the section characteristics"
        yield DeckFinding(deck.line_of("FLTCON", "VINF"), ERROR, text)
    if not air and deck.loop > 1:
        yield DeckFinding(
            line,
            ERROR,
            f"$FLTCON: LOOP={deck.loop} without atmosphere; the program takes LOOP=1 and "
            f"prints ERROR: write ALT",
        )
    has_pressure = _is_given(deck, "PINF") and _is_given(deck, "TINF")
    if has_pressure and _is_given(deck, "ALT"):
        text = (
            "$FLTCON: ALT and PINF with TINF; the program computes with PINF and TINF and "
            "prints ALT: write one"
        )
        yield DeckFinding(deck.line_of("FLTCON", "ALT"), WARNING, text)


def check_loop_lists(deck: Deck) -> Iterator[DeckFinding]:
    """Yield LOOP=1 with lists of different length."""
    # With LOOP=1 both lists step together.
    machs, heights = deck.value("FLTCON", "NMACH"), deck.value("FLTCON", "NALT")
    if deck.loop == 1 and _has_atmosphere(deck) and machs and heights and machs != heights:
        text = (
            f"$FLTCON: LOOP=1, NMACH={machs:g} and NALT={heights:g}; the program takes the "
            f"smaller of both and prints ERROR"
        )
        yield DeckFinding(
            deck.line_of("FLTCON", "NALT"), ERROR, f"{text}: make them equal, or write LOOP=2"
        )


def check_angle_schedule(deck: Deck) -> Iterator[DeckFinding]:
    """Yield angles of attack that do not rise; the program interpolates in their tables."""
    if fall := _find_fall(deck.schedule("FLTCON", "ALSCHD", "NALPHA")):
        text = (
            f"$FLTCON: the angles of attack do not rise: {fall}; the program interpolates in them, "
            f"and slopes, forces and damping are wrong: give rising ones"
        )
        yield DeckFinding(deck.line_of("FLTCON", "ALSCHD"), ERROR, text)


def check_deflection_schedule(deck: Deck) -> Iterator[DeckFinding]:
    """Yield deflections of a case with TRIM that do not rise.

    The increments at the trim deflection are interpolated: with 10, 0, -10, -20 deg the program
    prints those of -20 deg at every angle of attack.
    """
    if not deck.has("TRIM") or "SYMFLP" not in deck.namelists:
        return
    if fall := _find_fall(deck.schedule("SYMFLP", "DELTA", "NDELTA")):
        text = (
            f"$SYMFLP with TRIM: the deflections do not rise: {fall}; the program interpolates in "
            f"them, and D(CL) and drag at trim are those of one end: give rising ones"
        )
        yield DeckFinding(deck.line_of("SYMFLP", "DELTA"), ERROR, text)


def _find_fall(values: Sequence[float]) -> str:
    """Return in words the first pair of values that does not rise, an empty text without one."""
    for first, second in pairwise(values):
        if second <= first:
            return f"{first:g} is followed by {second:g}"
    return ""


def check_mach_regimes(deck: Deck) -> Iterator[DeckFinding]:
    """Yield limits of the Mach regimes that the program changes."""
    for name, low, high in (("STMACH", 0.6, 0.99), ("TSMACH", 1.01, 1.4)):
        limit = deck.value("FLTCON", name)
        if limit is not None and not low <= limit <= high:
            text = (
                f"$FLTCON: {name}={limit:g}; allowed is {low:g} ... {high:g}, the program "
                f"takes the nearest"
            )
            yield DeckFinding(deck.line_of("FLTCON", name), WARNING, text)


RULES = (
    check_value_counts,
    check_flight_conditions,
    check_atmosphere,
    check_loop_lists,
    check_angle_schedule,
    check_deflection_schedule,
    check_mach_regimes,
)
