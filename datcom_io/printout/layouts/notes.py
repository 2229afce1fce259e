"""Footnotes, messages of the program, and the numbers in them.

A footnote belongs to the tables of its page, and some footnotes change what a table means.  A
message states what the program did or refused to do.  It may stand between pages or between the
tables of a page.  Both may go on over several lines.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from datcom_io.printout.tables import PrintedValues, make_values

# First words of every line that continues a footnote or a message.
_CONTINUED = (
    "TAIL EFFECTS IGNORED]",
    "BOATTAIL EFFECTS IGNORED]",
    "APPLICABLE TO THE LINEAR LIFT REGION.",
    "ALL NAMES REFER TO NAMELIST",
    "FUSELAGE. FOR THIS CASE",
    "CLQ, CMQ, CLAD AND CMAD ARE",
    "CLAD AND CMAD ARE",
    "LINES FROM THE DEFLECTED CONTROLS.",
    "CONTROL ABOUT ITS HINGE LINE.",
    "TO THE PROGRAM EXECUTION SEQUENCE.",
    "** DENOTES THE INDEPENDENT VARIABLE",
    "SPANI IS REDEFINED",
    "REYNOLDS NUMBER WILL BE SET",
    "THE NEXT CASE WILL BE ATTEMPTED",
    "MACH WILL BE CALCULATED USING",
    "NMACH AND NALT ARE BOTH SET",
    "CONTROL TAB DATA WILL NOT BE",
    "CONTAINS ILLEGAL VARIABLE NAME",
    "IN NAMELIST BODY, ONLY",
    "FOR A CIRCULAR BODY",
    "FOR AN ELLIPTICAL BODY",
    "FOR OTHER BODY SHAPES",
    "SEE USERS MANUAL FOR SECTION",
)
# First words of the messages of the program.
_MESSAGES = (
    "WARNING*** ",
    "*** WARNING",
    "*** ERROR ",
    "ERROR-",
    "ERROR - ",
    "-ERROR-",
    "ERROR ** ",
    "ERROR TYPE CANNOT",
    "ERROR IN CARD BELOW",
    "ERROR(S),THIS CASE NOT RUN",
    "*** NAMELIST INPUT ERROR",
    "*** EXECUTION TERMINATING",
    "THIS CASE ABORTED",
    "MISSING PLANFORM FOR",
    "MISSING SECTION CHARACTERISTICS",
    "***** THE BODY IS NOT ADEQUATELY DEFINED",
    "**** REYNOLDS NUMBER TOO LOW",
    "********* COMPUTATIONS IN SUBROUTINE SLOPE HAVE FAILED",
    "LATERAL STABILITY DERIVATIVES ARE DELETED",
    "AIRFOIL MODULE UNABLE TO CALCULATE",
)
# This message begins with other words.
_BLOWN = "FLAP IS NOT EXTERNALLY BLOWN"
# First words of the footnotes below the tables of a page.
_FOOTNOTES = re.compile(
    r"\*{3} ?[A-Z]|\*{2,3} ?NOTE|\*NOTE\*|\*\* (?:BECAUSE|FOR CONFIGURATIONS)|\*\*  CD0="
    r"|ANALYSIS TERMINATED AT ALPHA|NOTE - |INPUT DIMENSIONS ARE IN "
)


class Footnote(NamedTuple):
    """A footnote that changes what a table means.

    ``phrase`` is printed in the footnote, ``word`` names it in the coordinate ``notes`` of a leaf,
    and ``meaning`` explains the word.
    """

    phrase: str
    word: str
    meaning: str


_FOOTNOTE_TABLE = (
    Footnote(
        "BECAUSE OF A LIMITATION ON BETA*(ASPECT RATIO)",
        "tail_increments",
        "CLQ, CMQ, CLAD and CMAD are increments of the horizontal tail only",
    ),
    Footnote(
        "FOR CONFIGURATIONS WITH A WING TAPER RATIO OTHER",
        "tail_alphadot_increments",
        "CLAD and CMAD are increments of the horizontal tail only",
    ),
    Footnote(
        "CLP CALCULATIONS ARE ONLY THE VERTICAL TAIL",
        "vertical_tail_CLP",
        "CLP is the increment of the vertical tail only",
    ),
    Footnote(
        "OUTPUT REFLECTS EXPERIMENTAL DATA INPUTS",
        "experimental_data",
        "the output reflects experimental data given in the input",
    ),
    Footnote(
        "DO NOT INCLUDE THE EFFECTS OF TWIN VERTICAL PANELS",
        "twin_panels_left_out",
        "lateral derivatives do not include the effects of twin vertical panels",
    ),
    Footnote(
        "THE HORIZONTAL TAIL LIES OFF THE BODY",
        "tail_off_body",
        "lateral derivatives do not include the effects of the horizontal tail, which lies off the "
        "body",
    ),
    Footnote(
        "CANARD CONFIGURATION",
        "canard",
        "canard configuration: effective downwash is partial output only",
    ),
    Footnote(
        "GROUND EFFECT ANALYSIS IS PERFORMED",
        "ground_beyond_linear",
        "ground effect is computed over all angles of attack, its method holds in the linear lift "
        "region only",
    ),
    Footnote(
        "CRANKED WING ANALYSIS",
        "cranked_wing",
        "analysis of a cranked wing although the wing has a low aspect ratio",
    ),
    Footnote(
        "DOUBLE DELTA WING ANALYSIS",
        "double_delta",
        "analysis of a double delta wing although the wing has a high aspect ratio",
    ),
    Footnote(
        "ANALYSIS TERMINATED AT ALPHA",
        "shock_detached",
        "the rows end where the leading-edge shock detaches",
    ),
    Footnote(
        "METHODS VALID FOR CONFIGURATIONS WITH LEADING(HINGE LINE)",
        "controls_ahead_of_mach_lines",
        "valid for controls with hinge line and trailing edge swept ahead of the Mach lines",
    ),
    Footnote(
        "DERIVATIVES ARE FOR STRAIGHT SIDED SYMMETRICAL",
        "biconvex_airfoils",
        "hinge moments are those of straight-sided symmetrical or biconvex airfoils",
    ),
    Footnote(
        "LACK OF CONTROL MOMENT",
        "trim_lack_of_moment",
        "trim ends or has gaps for lack of control moment",
    ),
    Footnote(
        "EXCEEDS ALPHA (CL) MAX",
        "trim_past_maximum_lift",
        "trim ends where the next angle of attack is past that of maximum lift",
    ),
    Footnote(
        "MOMENT DATA WAS UNAVAILABLE",
        "trim_without_wing_body_moment",
        "trim ends because the moment of the wing-body is not available",
    ),
)
FOOTNOTE_WORDS = {note.word: note.meaning for note in _FOOTNOTE_TABLE}
"""Words for the footnotes that change what a table means."""


class NumberPattern(NamedTuple):
    """A number in a footnote: kind of group, label, text with number and printed unit, unit."""

    group: str
    label: str
    pattern: re.Pattern[str]
    units: str = ""


# The second group of a pattern is the printed unit, empty without one.
_NUMBERS = (
    NumberPattern("weight", "VEHICLE WEIGHT", re.compile(r"VEHICLE WEIGHT = *(\S+) *(LB|N)?\b")),
    NumberPattern(
        "weight",
        "LEVEL FLIGHT LIFT COEFFICIENT",
        re.compile(r"LEVEL FLIGHT LIFT COEFFICIENT = *(\S+)()"),
    ),
    NumberPattern("note", "CD0", re.compile(r"\*\*  CD0= *(\S+)()")),
    NumberPattern(
        "note",
        "ANALYSIS TERMINATED AT ALPHA",
        re.compile(r"ANALYSIS TERMINATED AT ALPHA= *([-+.\d*]+)()"),
        "deg",
    ),
    NumberPattern("note", "SCALE FACTOR", re.compile(r"SCALE FACTOR IS *(\S+)()")),
)
# Pounds of weight are a force.
_PRINTED_UNITS = {"LB": "lbf", "N": "N"}
NAMES = ("weight", "note")
"""Kinds of group that `read_footnote_number` returns."""


def strip_control_column(line: str) -> str:
    """Return the words of a line without the carriage-control column.

    Two footnotes of the dynamic page start in that column.
    """
    if line.startswith("**"):
        return line.strip()
    return line[1:].strip()


def is_continuation(text: str) -> bool:
    """Return whether a line goes on with the footnote or message before it."""
    return text.startswith(_CONTINUED)


def sort_of(text: str) -> str:
    """Return ``message`` or ``note`` if a line opens a message or a footnote, else empty text."""
    if text.startswith(_MESSAGES) or _BLOWN in text:
        return "message"
    # A line of asterisks alone is a decoration.
    if _FOOTNOTES.match(text) and text.strip("*"):
        return "note"
    return ""


def list_footnote_words(texts: list[str]) -> list[str]:
    """Return the words of `FOOTNOTE_WORDS` for the notes of a page."""
    footnotes = []
    for note in _FOOTNOTE_TABLE:
        if any(note.phrase in text for text in texts):
            footnotes.append(note.word)
    return footnotes


def read_footnote_number(number: int, text: str) -> PrintedValues | None:
    """Return the number of a footnote, None when it has none."""
    for entry in _NUMBERS:
        match = entry.pattern.search(text)
        if match:
            units = _PRINTED_UNITS.get(match[2], entry.units)
            return make_values(entry.group, [(number, entry.label, match[1], units)])
    return None
