"""The vocabulary of the input deck: namelists with their variables, control cards, spellings and limits.

Sizes are those of the program's own reader; a value beyond them stops the run.  A size below zero denotes a logical variable.
"""

from __future__ import annotations

import re

_PLANFORM = "CHRDR CHRDBP CHRDTP SSPN SSPNE SSPNOP SAVSI SAVSO CHSTAT SWAFP TWISTA SSPNDD DHDADI DHDADO TYPE"
_SECTION = (
    "TOVC DELTAY XOVC CLI ALPHAI CLALPA(20) CLMAX(20) CMO LERI LERO CAMBER(-1) TOVCO XOVCO CMOT CLMAXL CLAMO TCEFF KSHARP SLOPE(6) "
    "ARCL XAC(20) DWASH YCM CLD TYPEIN NPTS XCORD(50) YUPPER(50) YLOWER(50) MEAN(50) THICK(50) ALPHAO"
)
_SIDE = "SVWB(20) SVB(20) SVHB(20)"
_EXPERIMENT = (
    "CDB(20) CLB(20) CMB(20) CLAB(20) CMAB(20) CDW(20) CLW(20) CMW(20) CLAW(20) CMAW(20) CDH(20) CLH(20) CMH(20) CLAH(20) CMAH(20) "
    "CDWB(20) CLWB(20) CMWB(20) CLAWB(20) CMAWB(20) CDV QOQINF(20) EPSLON(20) DEODA(20) ALPOW ALPLW ALPOH ALPLH ACLMW CLMW ACLMH CLMH"
)
_TEXT = {
    "FLTCON": (
        "NMACH MACH(20) NALPHA ALSCHD(20) RNNUB(20) HYPERS(-1) STMACH TSMACH TR NALT ALT(20) PINF(20) TINF(20) VINF(20) WT GAMMA LOOP"
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
    "PROPWR": "AIETLP NENGSP THSTCP PHALOC PHVLOC PRPRAD ENGFCT BWAPR3 BWAPR6 BWAPR9 NOPBPE BAPR75 YP CROT(-1)",
    "JETPWR": "AIETLJ NENGSJ THSTCJ JIALOC JEVLOC JEALOC JINLTA JEANGL JEVELO AMBTMP JESTMP JELLOC JETOTP AMBSTP JERAD",
    "SYMFLP": (
        "FTYPE NDELTA DELTA(9) PHETE PHETEP CHRDFI CHRDFO SPANFI SPANFO CPRMEI(9) CPRMEO(9) CAPINB(9) CAPOUT(9) DOBDEF(9) "
        "DOBCIN DOBCOT SCLD(9) SCMD(9) CB TC NTYPE JETFLP CMU DELJET(9) EFFJET(9) SCHA SCHD"
    ),
    "ASYFLP": "STYPE NDELTA SPANFI SPANFO PHETE DELTAL(9) DELTAR(9) CHRDFI CHRDFO DELTAD(9) DELTAS(9) XSOC(9) XSPRME HSOC(9)",
    "CONTAB": "TTYPE CFITC CFOTC BITC BOTC CFITT CFOTT BITT BOTT B1 B2 B3 B4 D1 D2 D3 GCMAX KS RL BGR DELR",
    "GRNDEF": "NGH GRDHT(10)",
    "LARWB": ("ZB SREF DELTEP SFRONT AR R3LEOB DELTAL L SWET PERBAS SBASE HB BB BLF(-1) XCG THETAD ROUNDN(-1) SBS SBSLB XCENSB XCENW"),
    "TRNJET": "NT TIME(10) FC(10) ALPHA(10) LAMNRJ(-10) SPAN PHE ME ISP GP CC LFP",
    "HYPEFF": "ALITD XHL TWOTI CF HNDLTA HDELTA(10) LAMNR(-1)",
}
_VARIABLE = re.compile(r"(\w+)(?:\((-?\d+)\))?")
VARIABLES: dict[str, dict[str, int]] = {
    name: {variable: int(size or 1) for variable, size in _VARIABLE.findall(text)}
    for name, text in {**_TEXT, **{f"EXPR{n:02d}": _EXPERIMENT for n in range(1, 21)}}.items()
}
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
    ("SYMFLP", "NDELTA", ("DELTA",), ("CPRMEI", "CPRMEO", "CAPINB", "CAPOUT", "DOBDEF", "SCLD", "SCMD", "DELJET", "EFFJET")),
    ("ASYFLP", "NDELTA", (), ("DELTAL", "DELTAR", "DELTAD", "DELTAS", "XSOC", "HSOC")),
    ("TRNJET", "NT", ("TIME", "FC"), ("ALPHA", "LAMNRJ")),
    ("HYPEFF", "HNDLTA", ("HDELTA",), ()),
    *((name, "NPTS", ("XCORD",), ("YUPPER", "YLOWER", "MEAN", "THICK")) for name in ("WGSCHR", "HTSCHR", "VTSCHR", "VFSCHR")),
)
"""Namelist, variable that counts, arrays that need so many values, arrays that may need them."""

DIMENSIONS = ("FT", "IN", "M", "CM")
CARD_COLUMNS = 80
CASEID_COLUMNS = 74
MOST_NAMELISTS = 299  # the program refuses the three-hundredth of a series of SAVE cases
