"""Quantity and unit of a column of a recorder, by its name."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from aeromatch.drafting.name_map.heading_words import (
    DECORATION,
    DOUBTFUL_SENSES,
    NAME_QUANTITY,
    OTHER_SUBJECT,
    QUALIFIERS,
    RECORDED,
    SENSE_WORDS,
    SENSES,
    SIDES,
)
from flightmech.errors import UnitError, UnknownName, find_symbol
from flightmech.names import COEFFICIENTS, lookup
from flightmech.units import fitted_unit, known_unit, parse_unit
from flighttest.records.readers.channel_correction import recorder_units
from flighttest.records.readers.columns import split_heading, units_at_the_end, words_of

_OF_ENGINES = (
    *("throttle", "pla", "n1", "n2", "fuel_flow", "thrust", "itt", "torque", "epr"),
    *("manifold_pressure", "rpm", "prop_command", "mixture", "cutoff"),
)
_NO_CHANNELS = ("time", "t", "S", "cbar", "b", *COEFFICIENTS)
_ENGINE_NUMBER = re.compile(r"(?:eng|engine|e)?([1-9])")
# A word with the number of its engine or sensor, such as FN1 or AOA2.
_NUMBERED_WORD = re.compile(r"([a-z]{2,})([1-9])")
_ANGLE_UNITS = ("deg", "rad")
# Words of a demand, which the position follows later.
_DEMANDS = frozenset({"cmd", "command", "commanded", "demand", "demanded", "dem", "target"})
# Letters of a name that is too short to be recognised in a part of a heading.
_SHORT = 2


@dataclass(frozen=True)
class Guess:
    """Possible quantity of a column.

    Attributes
    ----------
    name : str
        Canonical name.
    unit : str or None
        Unit in the name of the column.
    rank : int
        0 for a canonical name; it increases with the ignored part of the name.
    inverted : bool
        Whether the name is positive up and the quantity is positive down.
    sign : int
        -1 if the name states the opposite of the positive sense of the quantity, such as TEU for
        an elevator.
    doubt : str
        What else the sense in the name may mean.
    """

    name: str
    unit: str | None
    rank: int
    inverted: bool = False
    sign: int = 1
    doubt: str = ""


def guess_quantity(column: str) -> Guess | None:
    """Return the possible quantity of a column by its name, or None.

    Parameters
    ----------
    column : str
        Name in the file, with or without its unit in brackets. A table or group before it
        (``adc/KIAS``) matters for satellite receivers only.

    Examples
    --------
    >>> guess_quantity("Elevator_Pos_deg")
    Guess(name='delta_e', unit='deg', rank=2, inverted=False, sign=1, doubt='')
    >>> guess_quantity("KIAS").name, guess_quantity("KIAS").unit
    ('V_cas', 'kt')
    >>> guess_quantity("thrust_left_lbf").name
    'engine1.thrust'
    >>> guess_quantity("Roll Rate (deg/s)").name, guess_quantity("Roll Rate (deg/s)").unit
    ('p', 'deg/s')
    >>> guess_quantity("ELEV_DEG_TEU").name, guess_quantity("ELEV_DEG_TEU").sign
    ('delta_e', -1)
    >>> guess_quantity("spare_7") is None
    True
    """
    heading, stated = split_heading(column)
    name = _without_group(heading)
    guess = _guess_name(name, heading)
    # Some recorders add a field to the name of the channel: NAME.FIELD
    head, _, tail = name.rpartition(".")
    if guess is None and head and tail:
        guess = _guess_name(head, heading)
    if guess is None:
        return None
    unit = guess.unit
    if stated:
        unit = fitted_unit(stated, lookup(guess.name).units)
        if not _is_same_kind(unit, guess.name):
            return None
    return replace(guess, name=lever_by_unit(guess.name, unit), unit=unit)


def explain_unknown(column: str) -> str:
    """Return why a known heading of another subject gives no channel; empty for other headings.

    Examples
    --------
    >>> explain_unknown("EGT")
    'a temperature of the engine that no model uses'
    >>> explain_unknown("spare_7")
    ''
    """
    heading, _ = split_heading(column)
    words = words_of(_without_group(heading))
    words, _ = _split_number([word for word in words if word not in SENSE_WORDS])
    # The last words may be a unit.
    for length in range(len(words), 0, -1):
        part = [word for word in words[:length] if word not in DECORATION]
        reason = OTHER_SUBJECT.get("".join(part))
        if reason:
            return reason
    demand = sorted(_DEMANDS.intersection(words))
    if demand:
        return f"a demand ({demand[0]}) and no position"
    return ""


def _without_group(heading: str) -> str:
    """Return a heading without the table or group before its name: ``adc/KIAS`` gives KIAS.

    The slash of a unit, as in ``FF1 KG/H``, does not separate a group.
    """
    head, _, name = heading.rpartition("/")
    if not name:
        return heading
    last_word = re.split(r"[\s_]", head)[-1]
    return heading if last_word and _is_unit(f"{last_word}/{name}") else name


def _is_unit(text: str) -> bool:
    try:
        parse_unit(known_unit(text))
    except UnitError:
        return False
    return True


def lever_by_unit(name: str, unit: str | None) -> str:
    """Return the angle of a power lever for a lever in degrees, the fraction for one in percent."""
    if name.endswith(".throttle") and unit in _ANGLE_UNITS:
        return name.replace(".throttle", ".pla")
    if name.endswith(".pla") and unit == "%":
        return name.replace(".pla", ".throttle")
    return name


def load_factor_by_unit(guess: Guess | None, unit: str | None) -> Guess | None:
    """Return the accelerometer for a load factor ``nz`` whose unit is one of an acceleration."""
    if guess is None or guess.name != "nz" or unit is None or not _is_unit(unit):
        return guess
    if parse_unit(known_unit(unit))[0] != parse_unit("m s-2")[0]:
        return guess
    return replace(guess, name="az_imu", unit=unit, rank=1, inverted=True)


def _guess_name(name: str, column: str) -> Guess | None:
    canonical = _canonical_channel(name)
    if canonical:
        return Guess(canonical, None, 0)
    # An index at the end, such as accel[2], is not a word.
    words = words_of(re.sub(r"\[\d+\]$", "", name.rpartition(".")[2] or name))
    for position in range(len(words) - 1, 0, -1):
        if words[position] in SENSE_WORDS:
            remaining = words[:position] + words[position + 1 :]
            guess = _guess_with_sense(remaining, words[position], name=name, column=column)
            if guess is not None:
                return guess
    return _guess_words(words, name, column)


def _guess_with_sense(words: list[str], sense: str, name: str, column: str) -> Guess | None:
    """Return the guess with the sign of a sense, or None if the quantity has no such sense."""
    guess = _guess_words(words, name, column)
    if guess is None:
        return None
    sign = SENSES.get(guess.name, {}).get(sense)
    if sign is None:
        return None
    return replace(guess, sign=sign, doubt=DOUBTFUL_SENSES.get(sense, ""))


def _guess_words(words: list[str], name: str, column: str) -> Guess | None:
    """Return the guess of words whose last ones may be a unit."""
    # A unit has up to three words, such as deg per s.
    for length in (3, 2, 1):
        if length >= len(words):
            continue
        quantity = _quantity_of_words(words[:-length], column.lower())
        if quantity is None:
            continue
        for unit in units_at_the_end(words[-length:]):
            name_by_unit = lever_by_unit(quantity[0], unit)
            if _is_recorded_in(unit, name_by_unit):
                inverted = _is_load_factor(words[:-length])
                return Guess(name_by_unit, unit, quantity[1], inverted=inverted)
    quantity = _quantity_of_words(words, column.lower())
    if quantity is None:
        return None
    implied = _implied_unit(name, quantity[0])
    return Guess(quantity[0], implied, quantity[1], inverted=_is_load_factor(words))


def _is_load_factor(words: list[str]) -> bool:
    return "loadfactor" in "".join(words) or "nz" in words


def _canonical_channel(name: str) -> str:
    """Return the recorded channel of a canonical name, or an empty text for another name."""
    try:
        lookup(name)
    except UnknownName:
        return ""
    if name in _NO_CHANNELS:
        return ""
    if name in _OF_ENGINES:
        return f"engine1.{name}"
    return RECORDED.get(name, name)


def _quantity_of_words(words: list[str], column: str) -> tuple[str, int] | None:
    """Return the quantity of words, and the rank by the number of words that are ignored."""
    plain, engine = _split_number(words)
    bare = [word for word in plain if word not in DECORATION]
    # From all words to the last word, which names the quantity best.
    tries = [(words, 1), (plain, 1), (bare, 2)]
    for start in range(1, len(bare)):
        # A MAG heading, a CABIN altitude and a TRIM position are other quantities.
        if QUALIFIERS.intersection(bare[:start]):
            break
        tries.append((bare[start:], 2 + start))
    for part, rank in tries:
        text = "".join(part)
        if text in OTHER_SUBJECT:
            return None
        name = _quantity_of_text(text)
        if not name or name in _NO_CHANNELS:
            continue
        if rank > 2 and len(text) <= _SHORT and text not in ("n1", "n2"):
            continue
        # The words before it name another velocity, such as one over the ground.
        if rank > 2 and text in ("velocity", "speed"):
            continue
        if name == "h_baro" and ("gps" in column or "gnss" in column):
            name = "h_gps"
        return _number_quantity(name, engine), rank
    return None


def _quantity_of_text(text: str) -> str | None:
    """Return the recorded quantity of a name of a channel or of a symbol, or None."""
    if text in NAME_QUANTITY:
        return NAME_QUANTITY[text]
    symbol = find_symbol(text)
    return RECORDED.get(symbol or "", symbol)


def _split_number(words: list[str]) -> tuple[list[str], int]:
    """Return the words without the number or side of an engine or surface, and the number.

    The number is 0 if there is none.
    """
    plain: list[str] = []
    number = 0
    for position, word in enumerate(words):
        match = _ENGINE_NUMBER.fullmatch(word)
        numbered = _NUMBERED_WORD.fullmatch(word)
        if _is_side(words, position):
            number = SIDES[word]
        elif match and len(words) > 1:
            number = int(match[1])
        elif numbered and word not in NAME_QUANTITY and _is_name(numbered[1]):
            plain.append(numbered[1])
            number = int(numbered[2])
        elif word not in ("eng", "engine"):
            plain.append(word)
    return plain, number


def _is_name(word: str) -> bool:
    return word in NAME_QUANTITY or word in OTHER_SUBJECT


def _is_side(words: list[str], position: int) -> bool:
    """Return whether a word is the side of an engine or surface."""
    word = words[position]
    if word not in SIDES or len(words) == 1:
        return False
    # r_dot and r_rate are a yaw rate, not a right side.
    is_rate = len(words) == 2 and position == 0 and words[1] in ("dot", "rate")
    return not (word in ("l", "r") and is_rate)


def _number_quantity(name: str, number: int) -> str:
    """Return a quantity with the number of its engine or the side of its surface."""
    if name in _OF_ENGINES:
        name = f"engine.{name}"
    if name.startswith("engine."):
        return name.replace("engine.", f"engine{number or 1}.")
    if name in ("delta_a", "delta_f") and number in (1, 2):
        side = "left" if number == 1 else "right"
        return f"{name}_{side}"
    return name


def _implied_unit(name: str, quantity: str) -> str | None:
    """Return the knot for names such as KIAS and KTAS, rpm for names such as Prop RPM, or None."""
    if quantity.endswith(".rpm") and re.search(r"(?i)rpm", name):
        return "rpm"
    if quantity in ("V", "V_cas") and re.match(r"(?i)k(ias|cas|tas)", name):
        return "kt"
    return None


def explain_unit(column: str) -> str:
    """Return how the unit at the end of a heading contradicts its name; empty if it does not.

    Examples
    --------
    >>> explain_unit("AILERON_PCT")
    'the unit % of its heading contradicts delta_a, which is in rad'
    """
    words = [word for word in words_of(_without_group(column)) if word not in SENSE_WORDS]
    for length in (3, 2, 1):
        units = units_at_the_end(words[-length:]) if length < len(words) else []
        quantity = _quantity_of_words(words[:-length], column.lower()) if units else None
        if quantity is not None and not any(_is_recorded_in(unit, quantity[0]) for unit in units):
            name = quantity[0]
            return (
                f"the unit {units[0]} of its heading contradicts {name}, which is in "
                f"{lookup(name).units}"
            )
    return ""


def _is_recorded_in(unit: str, name: str) -> bool:
    """Return whether a unit is one of a quantity; an angle is not in percent."""
    if not _is_same_kind(unit, name):
        return False
    is_number = parse_unit(lookup(name).units)[0] == parse_unit("1")[0]
    return not is_number or fitted_unit(unit, lookup(name).units) in recorder_units(name)


def _is_same_kind(unit: str, name: str) -> bool:
    """Return whether a unit has the dimension of a quantity."""
    try:
        # A g is accepted for every quantity.
        dimension = parse_unit("m s-2" if unit == "g" else lookup(name).units)[0]
        # The lb of a force is the pound of force.
        if unit == "lb" and dimension == parse_unit("N")[0]:
            unit = "lbf"
        return parse_unit(unit)[0] == dimension
    except (UnknownName, UnitError):
        return False
