"""What to take out of the words of a bus or a frame: the ``[decode.NAME]`` tables of a name map.

Recordings of buses and telemetry hold words; which bits are which quantity is in the interface document of the aeroplane, so it is the
user's table.  Four kinds::

    [decode.adc]                    # ARINC 429 words of a Chapter 10 channel, or of a column of any other file
    kind = "arinc429"
    channel = 12                    # Chapter 10 channel identifier; with column = "table/word" words of another format
    bus = 0                         # of the channel; left out: all
    labels = "octal"                # label byte as octal number in bits 8-1; "transmitted" when bit 1 is the first sent, so reversed
    [decode.adc.parameters]
    tas = { label = "210", code = "bnr", bits = 15, range = 2048, unit = "kt" }
    alt_baro = { label = "235", code = "bcd", digits = 4, resolution = 1, unit = "hPa" }
    air = { label = "350", code = "discrete", bit = 11 }

    [decode.ins]                    # MIL-STD-1553 messages
    kind = "mil1553"
    channel = 3
    rt = 5
    subaddress = 1
    direction = "transmit"
    [decode.ins.parameters]
    theta = { word = 3, code = "twos", lsb = 0.0054931640625, unit = "deg" }
    lat = { word = [7, 8], code = "twos", lsb = 8.381903171539307e-08, unit = "deg" }

    [decode.fti]                    # PCM minor frames, packed or unpacked; words counted from 1 at the first word of the sync pattern
    kind = "pcm"
    channel = 7
    word_bits = 16
    frame_words = 64
    counter = { word = 3, first = 0 }        # subframe counter, for words that are not in every frame
    [decode.fti.parameters]
    pot_3 = { word = 9, code = "unsigned", bits = [0, 11], unit = "1" }
    nz = { word = [5, 37], repeated = true, code = "twos", lsb = 0.0005, unit = "g" }   # twice in each frame
    oil = { word = 12, frame = 2, frames = 4, code = "unsigned", unit = "1" }

    [decode.strain]                 # analogue samples
    kind = "analog"
    channel = 9
    [decode.strain.parameters]
    F_column = { subchannel = 1, code = "twos", lsb = 0.1, unit = "N" }

A parameter becomes a column of the table NAME (mil1553, analog, pcm words of every frame) or a
table of its own, ``NAME.parameter``, where it has stamps of its own (arinc429, repeated and
subframe words).  Bits of a word are counted from 0, the least significant.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from flightmech.errors import UnitError
from flightmech.support.toml_models import Strict
from flightmech.units import parse_unit

WordCode = Literal["unsigned", "twos", "offset", "magnitude", "float"]


def _unit_fault(name: str, unit: str) -> list[str]:
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
        found = []
        if not (self.label and set(self.label) <= set("01234567") and int(self.label, 8) <= 0o377):
            found.append(
                f'label: found {self.label!r}; expected an octal number in quotes, "001" to "377"'
            )
        needed = {"bnr": ("bits", "range"), "bcd": ("digits", "resolution"), "discrete": ("bit",)}[
            self.code
        ]
        every = ("bits", "range", "digits", "resolution", "bit")
        found += [
            f"{key}: missing; code {self.code!r} needs it"
            for key in needed
            if getattr(self, key) is None
        ]
        found += [
            f"{key}: has no meaning for code {self.code!r}"
            for key in every
            if key not in needed and getattr(self, key) is not None
        ]
        limits = {"bits": (1, 20), "digits": (1, 5), "bit": (9, 29)}
        for key, (low, high) in limits.items():
            if getattr(self, key) is not None and not low <= getattr(self, key) <= high:
                found.append(f"{key}: found {getattr(self, key)}; allowed {low} to {high}")
        return found


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
        found = [
            f"parameters.{name}.{text}"
            for name, label in self.parameters.items()
            for text in label.problems()
        ]
        for name, label in self.parameters.items():
            found += _unit_fault(name, label.unit)
        if (self.channel is None) == (self.column is None):
            found.append(
                "channel: give either a Chapter 10 channel or the column that holds the words"
            )
        return found


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
        return (self.word,) if isinstance(self.word, int) else self.word

    def problems(self) -> list[str]:
        """Return what is wrong with the table of this parameter."""
        found = [] if self.words and min(self.words) >= 1 else ["word: counted from 1"]
        if self.bits is not None and not 0 <= self.bits[0] <= self.bits[1]:
            found.append(
                f"bits: found {list(self.bits)}; expected [lowest, highest], counted from 0"
            )
        return found


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
        found = [
            f"parameters.{name}.{text}"
            for name, word in self.parameters.items()
            for text in word.problems()
        ]
        for name, word in self.parameters.items():
            found += _unit_fault(name, word.unit)
            if max(word.words, default=1) > 32:
                found.append(f"parameters.{name}.word: a message has 32 data words")
        for key in ("rt", "subaddress"):
            if not 0 <= getattr(self, key) <= 31:
                found.append(f"{key}: found {getattr(self, key)}; allowed 0 to 31")
        return found


class PcmWord(Word):
    """One parameter of PCM frames; `repeated` words stand several times in a frame, `frame` words
    once in `frames` frames.
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
    """The word that counts minor frames, and the value of it in the frame called 0."""

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
        found = [
            f"parameters.{name}.{text}"
            for name, word in self.parameters.items()
            for text in word.problems()
        ]
        if not 1 <= self.word_bits <= 64:
            found.append(f"word_bits: found {self.word_bits}; allowed 1 to 64")
        if not 1 <= self.frame_words <= 16384:
            found.append(f"frame_words: found {self.frame_words}; allowed 1 to 16384")
        for name, word in self.parameters.items():
            found += _unit_fault(name, word.unit)
            if max(word.words, default=1) > self.frame_words:
                found.append(f"parameters.{name}.word: a frame has {self.frame_words} words")
            if (word.frame is None) != (word.frames is None) or (
                word.frame is not None and self.counter is None
            ):
                found.append(
                    f"parameters.{name}.frame: needs `frames` next to it and the table's `counter`"
                )
            elif (
                word.frames is not None
                and word.frame is not None
                and not 0 <= word.frame < word.frames
            ):
                found.append(
                    f"parameters.{name}.frame: found {word.frame}; allowed 0 to {word.frames - 1}"
                )
            if word.repeated and word.frame is not None:
                found.append(f"parameters.{name}.repeated: not together with frame")
        return found


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
        return (
            []
            if 0 <= self.subchannel <= 255
            else [f"subchannel: found {self.subchannel}; allowed 0 to 255"]
        )


class Analog(Strict):
    """Parameters of analogue samples."""

    kind: Literal["analog"] = Field(description="Analogue samples.", examples=["analog"])
    channel: int = Field(description="Channel identifier of a Chapter 10 recording.", examples=[9])
    parameters: dict[str, Subchannel] = Field(
        description="Parameters of the inputs, by the name of the column that they become."
    )

    def problems(self) -> list[str]:
        """Return what is wrong with the table."""
        found = [
            f"parameters.{name}.{text}"
            for name, part in self.parameters.items()
            for text in part.problems()
        ]
        for name, part in self.parameters.items():
            found += _unit_fault(name, part.unit)
        return found


Decode = Arinc429 | Mil1553 | Pcm | Analog
KINDS: dict[str, type[Decode]] = {
    "arinc429": Arinc429,
    "mil1553": Mil1553,
    "pcm": Pcm,
    "analog": Analog,
}
