"""Vocabulary of the input deck: namelists and variables, control cards, spellings, limits, values.

Sizes are those of the reader of the program; a value beyond them stops the run.  A size below zero
denotes a logical variable.
"""

from __future__ import annotations

import re
from functools import lru_cache

from datcom_io.cells import OK, read_cell

# Variables that several namelists have in common, as name and size.
_PLANFORM = (
    "CHRDR CHRDBP CHRDTP SSPN SSPNE SSPNOP SAVSI SAVSO CHSTAT SWAFP TWISTA SSPNDD DHDADI "
    "DHDADO TYPE"
)
_SECTION = (
    "TOVC DELTAY XOVC CLI ALPHAI CLALPA(20) CLMAX(20) CMO LERI LERO CAMBER(-1) TOVCO XOVCO "
    "CMOT CLMAXL CLAMO TCEFF KSHARP SLOPE(6) "
    "ARCL XAC(20) DWASH YCM CLD TYPEIN NPTS XCORD(50) YUPPER(50) YLOWER(50) MEAN(50) "
    "THICK(50) ALPHAO"
)
_SIDE = "SVWB(20) SVB(20) SVHB(20)"
_EXPERIMENT = (
    "CDB(20) CLB(20) CMB(20) CLAB(20) CMAB(20) CDW(20) CLW(20) CMW(20) CLAW(20) CMAW(20) "
    "CDH(20) CLH(20) CMH(20) CLAH(20) CMAH(20) "
    "CDWB(20) CLWB(20) CMWB(20) CLAWB(20) CMAWB(20) CDV QOQINF(20) EPSLON(20) DEODA(20) "
    "ALPOW ALPLW ALPOH ALPLH ACLMW CLMW ACLMH CLMH"
)
_TEXT = {
    "FLTCON": (
        "NMACH MACH(20) NALPHA ALSCHD(20) RNNUB(20) HYPERS(-1) STMACH TSMACH TR NALT ALT(20) "
        "PINF(20) TINF(20) VINF(20) WT GAMMA LOOP"
    ),
    "OPTINS": "SREF CBARR ROUGFC BLREF",
    "SYNTHS": "XCG ZCG XW ZW ALIW XH ZH ALIH XV ZV XVF ZVF YV YF PHIV PHIF VERTUP(-1) HINAX SCALE",
    "BODY": "NX X(20) S(20) P(20) R(20) ZU(20) ZL(20) BNOSE BTAIL BLN BLA DS ITYPE METHOD ELLIP",
    "WGPLNF": _PLANFORM,
    "WGSCHR": _SECTION,
    "HTPLNF": f"{_PLANFORM} SHB(20) SEXT(20) RLPH(20)",
    "HTSCHR": _SECTION,
    "VTPLNF": f"{_PLANFORM} {_SIDE}",
    "VTSCHR": _SECTION,
    "VFPLNF": f"{_PLANFORM} {_SIDE}",
    "VFSCHR": _SECTION,
    "TVTPAN": "BVP BV BDV BH SV VPHITE VLP ZP",
    "PROPWR": "AIETLP NENGSP THSTCP PHALOC PHVLOC PRPRAD ENGFCT BWAPR3 BWAPR6 BWAPR9 NOPBPE "
    "BAPR75 YP CROT(-1)",
    "JETPWR": "AIETLJ NENGSJ THSTCJ JIALOC JEVLOC JEALOC JINLTA JEANGL JEVELO AMBTMP JESTMP "
    "JELLOC JETOTP AMBSTP JERAD",
    "SYMFLP": (
        "FTYPE NDELTA DELTA(9) PHETE PHETEP CHRDFI CHRDFO SPANFI SPANFO CPRMEI(9) CPRMEO(9) "
        "CAPINB(9) CAPOUT(9) DOBDEF(9) "
        "DOBCIN DOBCOT SCLD(9) SCMD(9) CB TC NTYPE JETFLP CMU DELJET(9) EFFJET(9) SCHA SCHD"
    ),
    "ASYFLP": "STYPE NDELTA SPANFI SPANFO PHETE DELTAL(9) DELTAR(9) CHRDFI CHRDFO DELTAD(9) "
    "DELTAS(9) XSOC(9) XSPRME HSOC(9)",
    "CONTAB": "TTYPE CFITC CFOTC BITC BOTC CFITT CFOTT BITT BOTT B1 B2 B3 B4 D1 D2 D3 GCMAX KS RL "
    "BGR DELR",
    "GRNDEF": "NGH GRDHT(10)",
    "LARWB": (
        "ZB SREF DELTEP SFRONT AR R3LEOB DELTAL L SWET PERBAS SBASE HB BB BLF(-1) XCG THETAD "
        "ROUNDN(-1) SBS SBSLB XCENSB XCENW"
    ),
    "TRNJET": "NT TIME(10) FC(10) ALPHA(10) LAMNRJ(-10) SPAN PHE ME ISP GP CC LFP",
    "HYPEFF": "ALITD XHL TWOTI CF HNDLTA HDELTA(10) LAMNR(-1)",
}
_VARIABLE = re.compile(r"(\w+)(?:\((-?\d+)\))?")
_MOST_EXPERIMENTS = 20  # EXPR01 ... EXPR20, one for each Mach number


def _read_sizes(text: str) -> dict[str, int]:
    """Return the size of each variable of a namelist."""
    return {variable: int(size or 1) for variable, size in _VARIABLE.findall(text)}


VARIABLES: dict[str, dict[str, int]] = {name: _read_sizes(text) for name, text in _TEXT.items()}
for _number in range(1, _MOST_EXPERIMENTS + 1):
    VARIABLES[f"EXPR{_number:02d}"] = _read_sizes(_EXPERIMENT)
"""Namelist to variable to size."""

_SECTION_SPELLINGS = {"CM0": "CMO", "CM0T": "CMOT", "CLAM0": "CLAMO", "ALPHA0": "ALPHAO"}
SPELLINGS: dict[str, dict[str, str]] = {
    "FLTCON": {"ALPHA": "ALSCHD"},
    **{name: _SECTION_SPELLINGS for name in ("WGSCHR", "HTSCHR", "VTSCHR", "VFSCHR")},
}
"""Namelist to second spelling to the name used here."""

CONTROL_WORDS = (
    "NEXT CASE",
    "DUMP",
    "SAVE",
    "CASEID",
    "TRIM",
    "DAMP",
    "PART",
    "PRINT EXTRAP",
    "BUILD",
    "NACA",
    "DERIV",
    "DIM",
    "NAMELIST",
    "PLOT",
)
"""Control cards; the program compares the first columns only."""

COUNTS: tuple[tuple[str, str, tuple[str, ...], tuple[str, ...]], ...] = (
    ("FLTCON", "NMACH", ("MACH", "VINF", "RNNUB"), ()),
    ("FLTCON", "NALPHA", ("ALSCHD",), ()),
    ("FLTCON", "NALT", ("ALT", "PINF", "TINF"), ()),
    ("BODY", "NX", ("X", "S", "P", "R"), ("ZU", "ZL")),
    ("GRNDEF", "NGH", ("GRDHT",), ()),
    (
        "SYMFLP",
        "NDELTA",
        ("DELTA",),
        ("CPRMEI", "CPRMEO", "CAPINB", "CAPOUT", "DOBDEF", "SCLD", "SCMD", "DELJET", "EFFJET"),
    ),
    ("ASYFLP", "NDELTA", (), ("DELTAL", "DELTAR", "DELTAD", "DELTAS", "XSOC", "HSOC")),
    ("TRNJET", "NT", ("TIME", "FC"), ("ALPHA", "LAMNRJ")),
    ("HYPEFF", "HNDLTA", ("HDELTA",), ()),
    *(
        (name, "NPTS", ("XCORD",), ("YUPPER", "YLOWER", "MEAN", "THICK"))
        for name in ("WGSCHR", "HTSCHR", "VTSCHR", "VFSCHR")
    ),
)
"""Namelist, variable that counts, arrays that need so many values, arrays that may need them."""

DIMENSIONS = ("FT", "IN", "M", "CM")
CARD_COLUMNS = 80
CASEID_COLUMNS = 74
MOST_NAMELISTS = 299  # the program refuses the three-hundredth of a series of SAVE cases
Value = float | bool
DIGITS = 9  # significant digits that identify any number of single precision
_LARGEST_INTEGER = 2**31 - 1
_LARGEST_REPEAT = 300
_LARGEST = 3.4e38  # of single precision
_SHOWN = 40  # characters of a value that a message shows
_REPEAT = re.compile(r"(\d{1,4}) ?\* ?(.+)")
_NUMBER = re.compile(r"[-+]?(\d*)(?:(\.)(\d*))?(?:(E)[-+]?\d{1,3})?")
_LOGICAL = re.compile(r"\.([TF])[A-Z]*\.?|([TF])|TRUE|FALSE")
_LOGICAL_FORMS = (".TRUE.", ".FALSE.", ".T.", ".F.")


def read_values(text: str) -> tuple[tuple[Value, ...], list[tuple[str, str]]]:
    """Read one value with its repeat count, ``3*2.0``.

    Returns
    -------
    values : tuple
        Empty when it is not a value.
    complaints : list of (str, str)
        Severity and text about a value that the program would not read as it is meant.

    Examples
    --------
    >>> read_values("3*2.0"), read_values(".TRUE.")
    (((2.0, 2.0, 2.0), []), ((True,), []))
    """
    # 3*2.0 stands for three values.
    repeat = _REPEAT.fullmatch(text)
    count, word = 1, text
    if repeat:
        count, word = int(repeat[1]), repeat[2].strip()
    if not 0 < count <= _LARGEST_REPEAT:
        return (), [("error", f"has the repeat count {count}; allowed is 1 ... {_LARGEST_REPEAT}")]
    if len(word) <= _LONGEST_CACHED:
        value, severity, complaint = _read_cached_value(word)
    else:
        value, severity, complaint = _read_value(word)
    values: tuple[Value, ...] = ()
    if value is not None:
        values = (value,) * count
    if not complaint:
        return values, []
    return values, [(severity, complaint)]


def _read_value(word: str) -> tuple[Value | None, str, str]:
    """Return a value, None for a word that is not one, with severity and text of a complaint.

    The text is empty for a value that the program reads as it is meant.
    """
    if _LOGICAL.fullmatch(word):
        complaint = ""
        if word not in _LOGICAL_FORMS:
            complaint = (
                f"has the value {word}; the program knows .TRUE. and .FALSE. with both points"
            )
        return "T" in word[:2], "error", complaint
    number = _NUMBER.fullmatch(word)
    if number and (number[1] or number[3]):
        return _read_number(word, number)
    if " " in word:
        value, severity, complaint = _read_value(word.replace(" ", ""))
        if complaint:
            return value, severity, complaint
        return value, "warning", f"has the value {word!r} with a blank in it"
    # Other spellings of a number, such as D exponents and lower case.
    cell = read_cell(word)
    if cell and cell[1] == OK and abs(cell[0]) <= _LARGEST:
        complaint = f"has the value {word}; the program reads only E exponents in upper case"
        return cell[0], "error", complaint
    return None, "error", f"has the value {_shorten(word)!r}, which is not a number"


def _read_number(word: str, number: re.Match[str]) -> tuple[Value | None, str, str]:
    """Return a number with severity and text of a complaint; `number` is its match of _NUMBER."""
    value = float(word)
    if abs(value) > _LARGEST:
        return None, "error", f"has the value {_shorten(word)}, which is too large"
    if _overflows(number[1] or "") or _overflows(number[3] or ""):
        complaint = (
            f"has the value {_shorten(word)}: too many digits, the program's integers "
            f"overflow; write {DIGITS} digits"
        )
        return value, "error", complaint
    if number[2]:
        return value, "warning", ""
    complaint = (
        f"has the value {word} without a point; the program uses it and flags a syntax error"
    )
    return value, "warning", complaint


# A run prints its cards once for the job and once for every case.
_read_cached_value = lru_cache(4096)(_read_value)
_LONGEST_CACHED = 24


def _overflows(digits: str) -> bool:
    """Return whether the digits before or behind the point overflow an integer of the program."""
    significant = digits.lstrip("0")
    return len(significant) > DIGITS + 1 or int(significant or 0) > _LARGEST_INTEGER


def _shorten(word: str) -> str:
    if len(word) <= _SHOWN:
        return word
    return f"{word[:_SHOWN]}..."


def format_namelist_value(value: Value) -> str:
    """Return a value as the program reads it, with nine significant digits.

    Examples
    --------
    >>> [format_namelist_value(x) for x in (2.0, -0.021, 1.0e-5, 4.0e6, 1.0e12, True)]
    ['2.0', '-0.021', '1.0E-5', '4000000.0', '1.0E12', '.TRUE.']
    """
    if isinstance(value, bool):
        return ".TRUE." if value else ".FALSE."
    # The program expects a decimal point and a capital E.
    mantissa, letter, exponent = f"{value:.{DIGITS}g}".partition("e")
    if "." not in mantissa:
        mantissa += ".0"
    if letter:
        return f"{mantissa}E{int(exponent)}"
    return mantissa
