"""Parameters in the words of a bus or a frame: the ``[decode.NAME]`` tables of a name map.

Recordings of buses and telemetry contain words.  The interface document of the aeroplane defines
the bits of each quantity, so that the user writes the table.  There are four kinds::

    # ARINC 429 words of a Chapter 10 channel, or of a column of any other file
    [decode.adc]
    kind = "arinc429"
    # Chapter 10 channel identifier; column = "table/word" for words of another format
    channel = 12
    # bus of the channel; without it all buses
    bus = 0
    # label byte as octal number in bits 8-1; "transmitted" if bit 1 is the first sent (reversed)
    labels = "octal"
    [decode.adc.parameters]
    tas = { label = "210", code = "bnr", bits = 15, range = 2048, unit = "kt" }
    alt_baro = { label = "235", code = "bcd", digits = 4, resolution = 1, unit = "hPa" }
    air = { label = "350", code = "discrete", bit = 11 }

    # MIL-STD-1553 messages
    [decode.ins]
    kind = "mil1553"
    channel = 3
    rt = 5
    subaddress = 1
    direction = "transmit"
    [decode.ins.parameters]
    theta = { word = 3, code = "twos", lsb = 0.0054931640625, unit = "deg" }
    lat = { word = [7, 8], code = "twos", lsb = 8.381903171539307e-08, unit = "deg" }

    # PCM minor frames, packed or unpacked; word 1 is the first word of the sync pattern
    [decode.fti]
    kind = "pcm"
    channel = 7
    word_bits = 16
    frame_words = 64
    # subframe counter, for words that are not in every frame
    counter = { word = 3, first = 0 }
    [decode.fti.parameters]
    pot_3 = { word = 9, code = "unsigned", bits = [0, 11], unit = "1" }
    # twice in each frame
    nz = { word = [5, 37], repeated = true, code = "twos", lsb = 0.0005, unit = "g" }
    oil = { word = 12, frame = 2, frames = 4, code = "unsigned", unit = "1" }

    # analogue samples
    [decode.strain]
    kind = "analog"
    channel = 9
    [decode.strain.parameters]
    F_column = { subchannel = 1, code = "twos", lsb = 0.1, unit = "N" }

A parameter of mil1553, analog or PCM words of every frame becomes a column of the table NAME.  A
parameter with stamps of its own (arinc429, repeated and subframe words) becomes a table
``NAME.parameter``.  Bits of a word are counted from 0, the least significant.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, Protocol

from pydantic import Field

from flightmech.errors import UnitError
from flightmech.support.toml_models import Strict
from flightmech.units import parse_unit

WordCode = Literal["unsigned", "twos", "offset", "magnitude", "float"]
# Limits of the keys of an ARINC 429 parameter.
_ARINC429_LIMITS = {"bits": (1, 20), "digits": (1, 5), "bit": (9, 29)}
_ARINC429_KEYS = {
    "bnr": ("bits", "range"),
    "bcd": ("digits", "resolution"),
    "discrete": ("bit",),
}
# Data words of a MIL-STD-1553 message, and largest address and subaddress.
_MIL1553_WORDS = 32
_MIL1553_ADDRESS = 31


class _Parameter(Protocol):
    def problems(self) -> list[str]: ...


def _parameter_problems(parameters: Mapping[str, _Parameter]) -> list[str]:
    """Return the problems of all parameters of a table."""
    problems = []
    for name, parameter in parameters.items():
        problems += [f"parameters.{name}.{text}" for text in parameter.problems()]
    return problems


def _unit_problems(name: str, unit: str) -> list[str]:
    try:
        parse_unit(unit)
    except UnitError as error:
        return [f"parameters.{name}.unit: {error}"]
    return []


class Arinc429Label(Strict):
    """One ARINC 429 parameter."""

    label: str = Field(description="Octal label in quotes.", examples=["210"])
    code: Literal["bnr", "bcd", "discrete"] = Field(
        description="Binary, decimal digits, or one bit.", examples=["bnr"]
    )
    sdi: Literal[0, 1, 2, 3] | None = Field(
        default=None,
        description="Source/destination identifier of the words taken; all without it.",
        examples=[1],
    )
    bits: int | None = Field(
        default=None, description="Significant bits of a bnr word.", examples=[15]
    )
    range: float | None = Field(
        default=None,
        description="Full scale, in unit: what 2 to the power of bits stands for.",
        examples=[2048],
    )
    digits: int | None = Field(default=None, description="Digits of a bcd word.", examples=[4])
    resolution: float | None = Field(
        default=None, description="Value of the last digit, in unit.", examples=[1]
    )
    bit: int | None = Field(default=None, description="Bit of a discrete, 9 to 29.", examples=[11])
    unit: str = Field(default="1", description="Unit of the value.", examples=["kt"])

    @property
    def number(self) -> int:
        """The label as a number."""
        return int(self.label, 8)

    def problems(self) -> list[str]:
        """Return what is wrong with the table of this parameter."""
        problems = []
        is_octal = bool(self.label) and set(self.label) <= set("01234567")
        if not (is_octal and self.number <= 0o377):
            problems.append(
                f'label: found {self.label!r}; expected an octal number in quotes, "001" to "377"'
            )
        # Each code has keys of its own.
        values = {}
        for keys in _ARINC429_KEYS.values():
            values.update({key: getattr(self, key) for key in keys})
        required = _ARINC429_KEYS[self.code]
        for key in required:
            if values[key] is None:
                problems.append(f"{key}: missing; code {self.code!r} needs it")
        for key, value in values.items():
            if key not in required and value is not None:
                problems.append(f"{key}: has no meaning for code {self.code!r}")
        # Bits of a word are counted from 1 by ARINC 429; the data field ends at bit 29.
        for key, (low, high) in _ARINC429_LIMITS.items():
            value = values[key]
            if value is not None and not low <= value <= high:
                problems.append(f"{key}: found {value}; allowed {low} to {high}")
        return problems


class Arinc429(Strict):
    """Parameters of ARINC 429 words."""

    kind: Literal["arinc429"] = Field(
        description="Words of an ARINC 429 bus.", examples=["arinc429"]
    )
    labels: Literal["octal", "transmitted"] = Field(
        description="Label byte as an octal number in bits 8-1, or transmitted: bit 1 is the "
        "first one sent.",
        examples=["octal"],
    )
    parameters: dict[str, Arinc429Label] = Field(
        description="Parameters of the words, by the name of the column that they become."
    )
    channel: int | None = Field(
        default=None, description="Channel identifier of a Chapter 10 recording.", examples=[12]
    )
    column: str | None = Field(
        default=None,
        description="TABLE/COLUMN with the words, in a file of another format.",
        examples=["bus/word"],
    )
    bus: int | None = Field(
        default=None, description="Bus of the channel; all without it.", examples=[0]
    )

    def problems(self) -> list[str]:
        """Return what is wrong with the table."""
        problems = _parameter_problems(self.parameters)
        for name, label in self.parameters.items():
            problems += _unit_problems(name, label.unit)
        if (self.channel is None) == (self.column is None):
            problems.append(
                "channel: give either a Chapter 10 channel or the column that holds the words"
            )
        return problems


class Word(Strict):
    """One parameter in a word, or in consecutive words, of a message or frame."""

    word: int | tuple[int, ...] = Field(
        description="Number of the word, counted from 1; a list for several, most significant "
        "first.",
        examples=[3],
    )
    code: WordCode = Field(description="Code of the number.", examples=["twos"])
    bits: tuple[int, int] | None = Field(
        default=None,
        description="[lowest, highest] bit, counted from 0; all without it.",
        examples=[[0, 11]],
    )
    lsb: float = Field(
        default=1.0, description="Value of the least significant bit, in unit.", examples=[0.0005]
    )
    offset: float = Field(default=0.0, description="Added to the value, in unit.", examples=[0.0])
    unit: str = Field(default="1", description="Unit of the value.", examples=["g"])

    @property
    def words(self) -> tuple[int, ...]:
        """The words, most significant first."""
        if isinstance(self.word, int):
            return (self.word,)
        return self.word

    def problems(self) -> list[str]:
        """Return what is wrong with the table of this parameter."""
        problems = []
        if not self.words or min(self.words) < 1:
            problems.append("word: counted from 1")
        if self.bits is not None and not 0 <= self.bits[0] <= self.bits[1]:
            problems.append(
                f"bits: found {list(self.bits)}; expected [lowest, highest], counted from 0"
            )
        return problems


class Mil1553(Strict):
    """Parameters in the data words of one MIL-STD-1553 message."""

    kind: Literal["mil1553"] = Field(
        description="Messages of a MIL-STD-1553 bus.", examples=["mil1553"]
    )
    channel: int = Field(description="Channel identifier of a Chapter 10 recording.", examples=[3])
    rt: int = Field(description="Address of the remote terminal, 0 to 31.", examples=[5])
    subaddress: int = Field(description="Subaddress of the message, 0 to 31.", examples=[1])
    direction: Literal["transmit", "receive"] = Field(
        description="Whether the terminal transmits or receives it.", examples=["transmit"]
    )
    parameters: dict[str, Word] = Field(
        description="Parameters of the words, by the name of the column that they become."
    )

    def problems(self) -> list[str]:
        """Return what is wrong with the table."""
        problems = _parameter_problems(self.parameters)
        for name, word in self.parameters.items():
            problems += _unit_problems(name, word.unit)
            if max(word.words, default=1) > _MIL1553_WORDS:
                problems.append(
                    f"parameters.{name}.word: a message has {_MIL1553_WORDS} data words"
                )
        for key in ("rt", "subaddress"):
            number = getattr(self, key)
            if not 0 <= number <= _MIL1553_ADDRESS:
                problems.append(f"{key}: found {number}; allowed 0 to {_MIL1553_ADDRESS}")
        return problems


class PcmWord(Word):
    """One parameter of PCM frames.

    A `repeated` word occurs several times in a frame, a word with `frame` once in `frames` frames.
    """

    repeated: bool = Field(
        default=False,
        description="Whether the words hold the parameter several times in a frame.",
        examples=[True],
    )
    frame: int | None = Field(
        default=None, description="Subframe that holds the parameter, counted from 0.", examples=[2]
    )
    frames: int | None = Field(default=None, description="Number of subframes.", examples=[4])


class Counter(Strict):
    """Word that counts minor frames, and its value in frame 0."""

    word: int = Field(description="Word that counts the frames.", examples=[3])
    first: int = Field(default=0, description="Its value in frame 0.", examples=[0])


class Pcm(Strict):
    """Parameters of PCM minor frames."""

    kind: Literal["pcm"] = Field(description="PCM minor frames.", examples=["pcm"])
    channel: int = Field(description="Channel identifier of a Chapter 10 recording.", examples=[7])
    word_bits: int = Field(description="Bits of a word, 1 to 64.", examples=[16])
    frame_words: int = Field(
        description="Words of a minor frame, counted from the first word of the sync pattern.",
        examples=[64],
    )
    parameters: dict[str, PcmWord] = Field(
        description="Parameters of the words, by the name of the column that they become."
    )
    counter: Counter | None = Field(
        default=None, description="Subframe counter, for parameters that are not in every frame."
    )

    def problems(self) -> list[str]:
        """Return what is wrong with the table."""
        problems = _parameter_problems(self.parameters)
        if not 1 <= self.word_bits <= 64:
            problems.append(f"word_bits: found {self.word_bits}; allowed 1 to 64")
        if not 1 <= self.frame_words <= 16384:
            problems.append(f"frame_words: found {self.frame_words}; allowed 1 to 16384")
        for name, word in self.parameters.items():
            problems += _unit_problems(name, word.unit)
            # The default serves an empty list of words, which is a problem of the word.
            if max(word.words, default=1) > self.frame_words:
                problems.append(f"parameters.{name}.word: a frame has {self.frame_words} words")
            problems += self._subframe_problems(name, word)
        return problems

    def _subframe_problems(self, name: str, word: PcmWord) -> list[str]:
        """Return what is wrong with the subframe of a parameter."""
        problems = []
        frame, frames = word.frame, word.frames
        # A word of one subframe needs number and count of the subframes, and their counter.
        is_incomplete = (frame is None) != (frames is None)
        if is_incomplete or (frame is not None and self.counter is None):
            problems.append(
                f"parameters.{name}.frame: needs `frames` next to it and the table's `counter`"
            )
        elif frames is not None and frame is not None and not 0 <= frame < frames:
            problems.append(f"parameters.{name}.frame: found {frame}; allowed 0 to {frames - 1}")
        if word.repeated and frame is not None:
            problems.append(f"parameters.{name}.repeated: not together with frame")
        return problems


class Subchannel(Strict):
    """One analogue input."""

    subchannel: int = Field(description="Analogue input, 0 to 255.", examples=[1])
    code: WordCode = Field(description="Code of the number.", examples=["twos"])
    lsb: float = Field(
        default=1.0, description="Value of the least significant bit, in unit.", examples=[0.1]
    )
    offset: float = Field(default=0.0, description="Added to the value, in unit.", examples=[0.0])
    unit: str = Field(default="1", description="Unit of the value.", examples=["N"])

    def problems(self) -> list[str]:
        """Return what is wrong with the table of this parameter."""
        if 0 <= self.subchannel <= 255:
            return []
        return [f"subchannel: found {self.subchannel}; allowed 0 to 255"]


class Analog(Strict):
    """Parameters of analogue samples."""

    kind: Literal["analog"] = Field(description="Analogue samples.", examples=["analog"])
    channel: int = Field(description="Channel identifier of a Chapter 10 recording.", examples=[9])
    parameters: dict[str, Subchannel] = Field(
        description="Parameters of the inputs, by the name of the column that they become."
    )

    def problems(self) -> list[str]:
        """Return what is wrong with the table."""
        problems = _parameter_problems(self.parameters)
        for name, subchannel in self.parameters.items():
            problems += _unit_problems(name, subchannel.unit)
        return problems


Decode = Arinc429 | Mil1553 | Pcm | Analog
KINDS: dict[str, type[Decode]] = {
    "arinc429": Arinc429,
    "mil1553": Mil1553,
    "pcm": Pcm,
    "analog": Analog,
}
