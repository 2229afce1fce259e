"""Exceptions and the warning class of the product.

Every message states what came, what is allowed and what to do. A failed match, a poor fit or a term
at its bound is a result and not an exception.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Any

from flightmech.short_text import without_middle

# longest line, and longest name, in the text of an error or a warning [character]
_LONGEST_LINE = 1500
_LONGEST_NAME = 100


def _with_short_lines(text: Any) -> Any:
    """Return a text whose lines are short enough to read.

    A file may have a name of 100 000 letters or a list of 20 000 names. The beginning and the end
    of a line have the fault and the remedy.
    """
    if not isinstance(text, str) or len(text) <= _LONGEST_LINE:
        return text
    return "\n".join(without_middle(line, _LONGEST_LINE) for line in text.split("\n"))


class AeromatchError(Exception):
    """Base of all errors that an input can cause. The exit code of the command line is 2.

    Lines of the text that have more than 1500 characters are shown without their middle.
    """

    def __init__(self, *texts: Any) -> None:
        super().__init__(*map(_with_short_lines, texts))

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the parts from which pickle makes the same error in another process.

        By default pickle would call the class with the text alone, and lose the attributes.
        """
        return _restore_error, (type(self), self.args, self.__dict__)


def _restore_error(
    kind: type[AeromatchError], texts: tuple[Any, ...], state: dict[str, Any]
) -> AeromatchError:
    error = kind.__new__(kind, *texts)
    error.__dict__.update(state)
    return error


class ParseError(AeromatchError):
    """A text file does not follow its format.

    Parameters
    ----------
    file : str
        Name of the file, or ``"<text>"``.
    line : int
        Line number, from 1. The number 0 means the whole file.
    found : str
        Content of the file at the fault.
    expected : str
        Content that the format requires, and the remedy.
    """

    def __init__(self, file: str, line: int, found: str, expected: str):
        self.file, self.line, self.found, self.expected = str(file), line, found, expected
        position = f"{file}, line {line}" if line else f"{file}"
        super().__init__(f"{position}: found {found}; expected {expected}")


def _join_names(names: Iterable[str]) -> str:
    return ", ".join(without_middle(name, _LONGEST_NAME) for name in names)


class UnknownName(AeromatchError):
    """A name that is not in the vocabulary, or not in the file that is read."""

    def __init__(self, name: str, allowed: Iterable[str], what: str = "name", hint: str = ""):
        self.name, self.allowed = name, sorted(allowed)
        near = near_names(name, self.allowed)
        text = f"unknown {what} {without_middle(repr(name), _LONGEST_NAME)}"
        if near:
            text += f"; near it: {_join_names(near)}"
        elif len(self.allowed) <= _MOST_ALLOWED:
            text += f"; allowed: {_join_names(self.allowed) or 'none'}"
        if hint:
            text += f"; {hint}"
        super().__init__(text)


# longest list of allowed names in a message
_MOST_ALLOWED = 40

# by symbol of this package: other names in the literature, in lower case without separators
_SYNONYMS = {
    "cbar": "chord meanchord wingchord mac meanaerodynamicchord cref lref",
    "b": "span wingspan bref",
    "S": "area wingarea referencearea sref sw",
    "psi": "heading yaw yawangle azimuth hdg",
    "theta": "pitch pitchangle",
    "phi": "roll rollangle bank bankangle",
    "p": "rollrate",
    "q": "pitchrate",
    "r": "yawrate",
    "alpha": "aoa angleofattack incidence",
    "beta": "aos sideslip angleofsideslip",
    "V": "tas airspeed trueairspeed speed velocity",
    "V_cas": "cas ias calibratedairspeed indicatedairspeed kcas kias",
    "h": "altitude height alt",
    "h_agl": "agl heightaboveground radioaltitude",
    "qbar": "dynamicpressure",
    "delta_e": "elevator",
    "delta_a": "aileron ailerons",
    "delta_r": "rudder",
    "delta_f": "flap flaps",
    "delta_t": "tab trimtab",
    "speedbrake": "airbrake airbrakes speedbrakes",
    "throttle": "powerlever thrustlever tla pla",
    "mass": "weight",
    "mach": "machnumber",
    "temperature": "oat sat",
    "p_static": "staticpressure",
    "q_c": "impactpressure",
    "Ixx": "ix",
    "Iyy": "iy",
    "Izz": "iz",
}
_SYMBOL: dict[str, str] = {}
for _symbol, _names in _SYNONYMS.items():
    _SYMBOL.update(dict.fromkeys(_names.split(), _symbol))


def find_symbol(name: str) -> str | None:
    """Return the symbol of a quantity for another of its names, None if the name is unknown.

    Examples
    --------
    >>> find_symbol("mean chord")
    'cbar'
    """
    return _SYMBOL.get("".join(letter for letter in name.lower() if letter.isalnum()))


def near_names(name: str, allowed: Iterable[str], count: int = 4, cutoff: float = 0.5) -> list[str]:
    """Return the allowed names that a user may have meant.

    A synonym of an allowed name gives this name alone. Otherwise the result is the allowed names of
    similar spelling.

    Parameters
    ----------
    name : str
        Unknown name.
    allowed : iterable of str
    count, cutoff
        As in `difflib.get_close_matches`.
    """
    allowed = list(allowed)
    # "reference.mean chord" can mean "reference.cbar"
    head, dot, tail = name.rpartition(".")
    synonym = f"{head}{dot}{find_symbol(tail)}"
    if synonym in allowed:
        return [synonym]
    return get_close_matches(name, dict.fromkeys(allowed), n=count, cutoff=cutoff)


class UnitError(AeromatchError):
    """A unit that is unknown or belongs to another quantity."""


# largest number of problems in the text of an error
_MOST_PROBLEMS = 200


class SchemaError(AeromatchError):
    """An object does not follow its schema.

    ``problems`` has all faults. The text has the first 200.
    """

    def __init__(self, what: str, problems: Sequence[str]):
        self.what, self.problems = what, list(problems)
        count = len(self.problems)
        plural = "" if count == 1 else "s"
        lines = [f"{what}: {count} problem{plural}"]
        lines += [f"  - {problem}" for problem in self.problems[:_MOST_PROBLEMS]]
        if count > _MOST_PROBLEMS:
            lines.append(f"  - and {count - _MOST_PROBLEMS} more")
        super().__init__("\n".join(lines))


class OutOfRange(AeromatchError):
    """Values outside the range of a table, a record or a limit. ``mask`` flags the values."""

    def __init__(self, text: str, mask: Any = None):
        self.mask = mask
        super().__init__(text)


class IdentificationError(AeromatchError):
    """An estimate is not possible: too few data, no excitation or a rank defect.

    The text names the combination of parameters.
    """


class SimulationError(AeromatchError):
    """A simulation stopped at ``time``. [s]"""

    def __init__(self, text: str, time: float = float("nan")):
        self.time = time
        super().__init__(text)


class AeromatchWarning(UserWarning):
    """A condition that the user should know, and that does not stop the work.

    Long lines of its text are shown as those of an `AeromatchError`.
    """

    def __init__(self, *texts: Any) -> None:
        super().__init__(*map(_with_short_lines, texts))
