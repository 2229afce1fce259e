"""Quantity and unit of a column of a recorder, by its name."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from flightmech.errors import UnitError, UnknownName, find_symbol
from flightmech.names import COEFFICIENTS, lookup
from flightmech.units import fitted_unit, parse_unit
from flighttest.records.readers.columns import split_heading, units_at_the_end, words_of

# Names of channels in recorders, in lower case without separators. The symbols of the field are
# known to `flightmech.errors.find_symbol`.
HEADING_WORDS = {
    "p": "p ratep rollrate bodyrollrate gyrox gyrp wx",
    "q": "q rateq pitchrate bodypitchrate gyroy gyrq wy",
    "r": "r rater yawrate bodyyawrate gyroz gyrr wz",
    "phi": "bank roll euler1 attroll",
    "theta": "pitch attpitch pitchattitude",
    "psi": "hdgtrue trueheading headingtrue trueyaw yaw heading",
    "ax_imu": "ax nx accx xacc accelx axb axbody longacc longitudinalacc longitudinalaccel "
    "longitudinalacceleration forwardacceleration",
    "ay_imu": "ay ny accy yacc accely ayb aybody latacc lateralacc lateralaccel lateralacceleration",
    "az_imu": "az nz accz zacc accelz azb azbody normacc normalacc normalaccel normalacceleration "
    "verticalacceleration loadfactor "
    "normalloadfactor gload",
    "alpha_vane": "alpha aoa alphavane aoavane vanealpha angleofattack incidence",
    "beta_vane": "beta aos betavane aosvane vanebeta sideslip sideslipangle angleofsideslip ssa",
    "V": "tas ktas vtas vtrue trueairspeed v airspeedtrue",
    "V_cas": "cas ias vcas vias kcas kias calibratedairspeed indicatedairspeed vc vi airspeed",
    "mach": "mach machnumber ma",
    "q_c": "qc impactpressure pitotpressure diffpressure differentialpressure dynamicpressure",
    "qbar": "qbar",
    "p_static": "ps pstat staticpress staticpressure pstatic baropressure ambientpressure",
    "temperature": "oat sat temperature outsideairtemperature outsidetemperature "
    "statictemperature airtemperature temp",
    "h_baro": "h hp alt altitude height pressurealtitude pressalt baroaltitude baroalt altbaro "
    "palt hbaro altpress",
    "h_gps": "hgps altgps gpsalt gpsaltitude gpsheight altitudegps gnssaltitude gnssheight",
    "h_radio": "hradio radioaltitude radioalt radalt ralt radaralt radaraltitude radioheight "
    "raltitude",
    "vn": "vn vnorth velnorth velocitynorth northvelocity gpsvn veln vgn northspeed gsnorth "
    "groundspeednorth",
    "ve": "ve veast veleast velocityeast eastvelocity gpsve vele vge eastspeed gseast "
    "groundspeedeast",
    "vd": "vd vdown veldown velocitydown downvelocity gpsvd veld vgd downspeed",
    "hdot": "hdot climbrate rateofclimb roc vsi verticalspeed verticalvelocity vs vspeed",
    "lat": "lat latitude gpslat gpslatitude",
    "lon": "lon long longitude gpslon gpslongitude",
    "delta_e": "elevator elev de ele deltae dele",
    "delta_a": "aileron ail da deltaa dail",
    "delta_r": "rudder rud dr deltar drud",
    "delta_f": "flap flaps df deltaf flapangle",
    "delta_t": "trimtab elevatortab elevatortrim elevtrim pitchtrim elevatortrimtab",
    "gear": "gear landinggear undercarriage gearextension geardown",
    "speedbrake": "speedbrake airbrake speedbrakes airbrakes",
    "column": "column controlcolumn pitchstick sticklong stickpitch columntravel",
    "wheel": "wheel controlwheel rollstick sticklat stickroll",
    "pedal": "pedal pedals rudderpedal rudderpedals",
    "F_column": "fcolumn stickforce elevatorforce columnforce stickforcepitch pitchforce "
    "stickforcelong",
    "F_wheel": "fwheel wheelforce stickforceroll rollforce",
    "F_pedal": "fpedal pedalforce rudderforce",
    "mass": "mass grossmass weight grossweight grosswt gw wt",
    "x_cg_b": "xcg",
    "y_cg_b": "ycg",
    "z_cg_b": "zcg",
    "engine.throttle": "throttle powerlever thr thrustlever tla throttlelever",
    "engine.pla": "pla powerleverangle",
    "engine.n1": "n1 fanspeed",
    "engine.n2": "n2",
    "engine.fuel_flow": "fuelflow ff wf",
    "engine.thrust": "thrust netthrust fn enginethrust",
    "engine.itt": "itt",
    "engine.torque": "torque trq",
}
# Quantity of each name of a channel.
_NAME: dict[str, str] = {}
for _quantity, _names in HEADING_WORDS.items():
    _NAME |= dict.fromkeys(_names.split(), _quantity)
# Recorded quantity of each canonical name that is a corrected quantity.
_RECORDED = {
    "x_cg": "x_cg_b",
    "alpha": "alpha_vane",
    "beta": "beta_vane",
    "h": "h_baro",
    "ax": "ax_imu",
    "ay": "ay_imu",
    "az": "az_imu",
}
# Words of a heading that do not name a quantity.
_DECORATION_TEXT = (
    "pos position defl deflection angle ang meas measured sensor raw value act actual filtered "
    "filt corr corrected body rec surf surface lever adc ins ahrs imu ads fms efis irs dau daq "
    "fdr egi nav air adhrs"
)
_DECORATION = frozenset(_DECORATION_TEXT.split())
# Sign of a heading with a word for a direction: +1 if it is the positive direction of the quantity,
# -1 if it is the opposite one. Positive are trailing edge down, trailing edge left, and an aileron
# deflection that rolls to the left.
_TRAILING_EDGE = {"teu": -1, "ted": 1}
_NOSE_UP = {"anu": 1, "nu": 1, "and": -1, "nd": -1}
_RIGHT_WING_DOWN = {"rwd": 1, "lwd": -1}
_NOSE_RIGHT = {"anr": 1, "nr": 1, "anl": -1, "nl": -1}
_SENSES = {
    "delta_e": {"teu": -1, "ted": 1, "anu": -1, "nu": -1, "and": 1, "nd": 1, "up": -1, "dn": 1},
    "delta_a": {"lwd": 1, "rwd": -1, "teu": -1, "ted": 1},
    "delta_a_left": _TRAILING_EDGE,
    "delta_a_right": _TRAILING_EDGE,
    "delta_f": _TRAILING_EDGE,
    "delta_t": _TRAILING_EDGE,
    "delta_r": {"tel": 1, "ter": -1, "anl": 1, "nl": 1, "anr": -1, "nr": -1},
    "theta": _NOSE_UP,
    "q": _NOSE_UP,
    "alpha_vane": _NOSE_UP,
    "phi": _RIGHT_WING_DOWN,
    "p": _RIGHT_WING_DOWN,
    "psi": _NOSE_RIGHT,
    "r": _NOSE_RIGHT,
}
# Number of an engine or of a surface by the word for its side.
_SIDES = {"l": 1, "lh": 1, "left": 1, "port": 1, "r": 2, "rh": 2, "right": 2, "stbd": 2}
_SENSE_WORDS = frozenset().union(*_SENSES.values())
_OF_ENGINES = ("throttle", "pla", "n1", "n2", "fuel_flow", "thrust", "itt", "torque")
_NO_CHANNELS = ("time", "t", "S", "cbar", "b", *COEFFICIENTS)
_ENGINE_NUMBER = re.compile(r"(?:eng|engine|e)?([1-9])")
_NUMBERED_QUANTITY = re.compile(r"(throttle|thrust|pla|tla|thr|torque|itt)([1-9])")
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
    """

    name: str
    unit: str | None
    rank: int
    inverted: bool = False
    sign: int = 1


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
    Guess(name='delta_e', unit='deg', rank=2, inverted=False, sign=1)
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
    name = heading.rpartition("/")[2] or heading
    guess = _guess_name(name, heading)
    # Some recorders add a field to the name of the channel: NAME.FIELD
    head, _, tail = name.rpartition(".")
    if guess is None and head and tail:
        guess = _guess_name(head, heading)
    if guess is None or not stated:
        return guess
    unit = fitted_unit(stated, lookup(guess.name).units)
    if not _is_same_kind(unit, guess.name):
        return None
    return replace(guess, unit=unit)


def _guess_name(name: str, column: str) -> Guess | None:
    canonical = _canonical_channel(name)
    if canonical:
        return Guess(canonical, None, 0)
    # An index at the end, such as accel[2], is not a word.
    words = words_of(re.sub(r"\[\d+\]$", "", name.rpartition(".")[2] or name))
    for position in range(len(words) - 1, 0, -1):
        if words[position] in _SENSE_WORDS:
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
    sign = _SENSES.get(guess.name, {}).get(sense)
    if sign is None:
        return None
    return replace(guess, sign=sign)


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
            if _is_same_kind(unit, quantity[0]):
                inverted = _is_load_factor(words[:-length])
                return Guess(quantity[0], unit, quantity[1], inverted=inverted)
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
    return _RECORDED.get(name, name)


def _quantity_of_words(words: list[str], column: str) -> tuple[str, int] | None:
    """Return the quantity of words, and the rank by the number of words that are ignored."""
    plain, engine = _split_number(words)
    bare = [word for word in plain if word not in _DECORATION]
    # From all words to the last word, which names the quantity best.
    tries = [(words, 1), (plain, 1), (bare, 2)]
    for start in range(1, len(bare)):
        tries.append((bare[start:], 2 + start))
    for part, rank in tries:
        text = "".join(part)
        name = _quantity_of_text(text)
        if not name:
            continue
        if rank > 2 and len(text) <= _SHORT and text not in ("n1", "n2"):
            continue
        if name == "h_baro" and ("gps" in column or "gnss" in column):
            name = "h_gps"
        return _number_quantity(name, engine), rank
    return None


def _quantity_of_text(text: str) -> str | None:
    """Return the recorded quantity of a name of a channel or of a symbol, or None."""
    if text in _NAME:
        return _NAME[text]
    symbol = find_symbol(text)
    return _RECORDED.get(symbol or "", symbol)


def _split_number(words: list[str]) -> tuple[list[str], int]:
    """Return the words without the number or side of an engine or surface, and the number.

    The number is 0 if there is none.
    """
    plain: list[str] = []
    number = 0
    for position, word in enumerate(words):
        match = _ENGINE_NUMBER.fullmatch(word)
        numbered = _NUMBERED_QUANTITY.fullmatch(word)
        if _is_side(words, position):
            number = _SIDES[word]
        elif match and len(words) > 1:
            number = int(match[1])
        elif numbered:
            plain.append(numbered[1])
            number = int(numbered[2])
        elif word not in ("eng", "engine"):
            plain.append(word)
    return plain, number


def _is_side(words: list[str], position: int) -> bool:
    """Return whether a word is the side of an engine or surface."""
    word = words[position]
    if word not in _SIDES or len(words) == 1:
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
    """Return the knot for names such as KIAS and KTAS, or None."""
    if quantity in ("V", "V_cas") and re.match(r"(?i)k(ias|cas|tas)", name):
        return "kt"
    return None


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
