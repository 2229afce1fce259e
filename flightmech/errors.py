"""The exceptions of the package and its warning.

Every text states what came, what is allowed and what to do.  A failed match, a poor fit or a term
at its bound is a result and never an exception.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Any


class AeromatchError(Exception):
    """Root of all errors that a user's input can cause; the command line turns it into exit code 2."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what another process makes the same error of; an exception is else made anew of
        its text alone.
        """
        return _as_raised, (type(self), self.args, self.__dict__)


def _as_raised(
    kind: type[AeromatchError], texts: tuple[Any, ...], state: dict[str, Any]
) -> AeromatchError:
    error = kind.__new__(kind, *texts)
    error.__dict__.update(state)
    return error


class ParseError(AeromatchError):
    """A text file does not hold what its format demands.

    Parameters
    ----------
    file : str
        Name of the file, or ``"<text>"``.
    line : int
        Line number, from 1; 0 when the fault belongs to the whole file.
    found : str
        What stands there.
    expected : str
        What the format requires, and what to do.
    """

    def __init__(self, file: str, line: int, found: str, expected: str):
        self.file, self.line, self.found, self.expected = str(file), line, found, expected
        place = f"{file}, line {line}" if line else f"{file}"
        super().__init__(f"{place}: found {found}; expected {expected}")


class UnknownName(AeromatchError):
    """A name that is not in the vocabulary or not in the file at hand."""

    def __init__(self, name: str, allowed: Iterable[str], what: str = "name", hint: str = ""):
        self.name, self.allowed = name, sorted(allowed)
        near = near_names(name, self.allowed)
        text = f"unknown {what} {name!r}"
        if near:
            text += f"; near it: {', '.join(near)}"
        elif len(self.allowed) <= 40:
            text += f"; allowed: {', '.join(self.allowed) or 'none'}"
        super().__init__(text + (f"; {hint}" if hint else ""))


# other names of the field, in lower case without separators, and the symbol that this package uses
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
_SYMBOL = {name: symbol for symbol, names in _SYNONYMS.items() for name in names.split()}


def find_symbol(name: str) -> str | None:
    """Return the symbol of this package for another name of the field, such as ``cbar`` for ``mean
    chord``; None where none is known.
    """
    return _SYMBOL.get("".join(letter for letter in name.lower() if letter.isalnum()))


def near_names(name: str, allowed: Iterable[str], count: int = 4, cutoff: float = 0.5) -> list[str]:
    """Return the names a user may have meant: another name of the field for one of `allowed`, else
    those spelt alike.

    Parameters
    ----------
    name : str
        What came.
    allowed : iterable of str
    count, cutoff
        Of `difflib.get_close_matches`.
    """

    allowed = list(allowed)
    head, dot, tail = name.rpartition(".")
    meant = f"{head}{dot}{find_symbol(tail)}"
    return (
        [meant]
        if meant in allowed
        else get_close_matches(name, dict.fromkeys(allowed), n=count, cutoff=cutoff)
    )


class UnitError(AeromatchError):
    """A unit that is unknown or belongs to another quantity."""


_MOST_SHOWN = 200  # problems in the text of an error; nobody reads more


class SchemaError(AeromatchError):
    """An object breaks its schema; ``problems`` holds every fault found, not only the first; the
    text the first 200.
    """

    def __init__(self, what: str, problems: Sequence[str]):
        self.what, self.problems = what, list(problems)
        count = len(self.problems)
        head = f"{what}: {count} problem{'s' if count != 1 else ''}"
        shown = [f"\n  - {p}" for p in self.problems[:_MOST_SHOWN]]
        more = f"\n  - and {count - _MOST_SHOWN} more" if count > _MOST_SHOWN else ""
        super().__init__(head + "".join(shown) + more)


class OutOfRange(AeromatchError):
    """Values outside the range of a table, a record or a limit; ``mask`` flags them."""

    def __init__(self, text: str, mask=None):
        self.mask = mask
        super().__init__(text)


class IdentificationError(AeromatchError):
    """An estimate cannot be made: too few data, no excitation or a rank defect; the text names the
    combination.
    """


class SimulationError(AeromatchError):
    """A simulation stopped; ``time`` states when. [s]"""

    def __init__(self, text: str, time: float = float("nan")):
        self.time = time
        super().__init__(text)


class AeromatchWarning(UserWarning):
    """Something the user should know that did not stop the work."""
