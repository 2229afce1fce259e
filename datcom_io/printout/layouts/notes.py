"""Footnotes, messages of the program, and the numbers that stand in them.

A footnote belongs to the tables of its page: some of them change what a table means.  A message
states what the program did or refused to do; it may stand between pages or between the tables of
one.  Both may go on over several lines.
"""

from __future__ import annotations

import re

from datcom_io.printout.tables import Values, make_values

# first words of every line that continues a footnote or a message
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
_BLOWN = "FLAP IS NOT EXTERNALLY BLOWN"
_FOOTNOTES = re.compile(
    r"\*{3} ?[A-Z]|\*{2,3} ?NOTE|\*NOTE\*|\*\* (?:BECAUSE|FOR CONFIGURATIONS)|\*\*  "
    r"CD0=|ANALYSIS TERMINATED AT ALPHA|NOTE - "
    r"|INPUT DIMENSIONS ARE IN "
)

FOOTNOTE_WORDS = {
    "tail_increments": "CLQ, CMQ, CLAD and CMAD are increments of the horizontal tail only",
    "tail_alphadot_increments": "CLAD and CMAD are increments of the horizontal tail only",
    "vertical_tail_CLP": "CLP is the increment of the vertical tail only",
    "experimental_data": "the output reflects experimental data given in the input",
    "twin_panels_left_out": "lateral derivatives do not include the effects of twin vertical panels",
    "tail_off_body": "lateral derivatives do not include the effects of the horizontal tail, "
    "which lies off the body",
    "canard": "canard configuration: effective downwash is partial output only",
    "ground_beyond_linear": "ground effect is computed over all angles of attack, its method "
    "holds in the linear lift region only",
    "cranked_wing": "analysis of a cranked wing although the wing has a low aspect ratio",
    "double_delta": "analysis of a double delta wing although the wing has a high aspect ratio",
    "shock_detached": "the rows end where the leading-edge shock detaches",
    "controls_ahead_of_mach_lines": "valid for controls with hinge line and trailing edge swept "
    "ahead of the Mach lines",
    "biconvex_airfoils": "hinge moments are those of straight-sided symmetrical or biconvex "
    "airfoils",
    "trim_lack_of_moment": "trim ends or has gaps for lack of control moment",
    "trim_past_maximum_lift": "trim ends where the next angle of attack is past that of maximum "
    "lift",
    "trim_without_wing_body_moment": "trim ends because the moment of the wing-body is not "
    "available",
}
"""Words for the footnotes that change what a table means."""

_WORDS_OF = {
    "BECAUSE OF A LIMITATION ON BETA*(ASPECT RATIO)": "tail_increments",
    "FOR CONFIGURATIONS WITH A WING TAPER RATIO OTHER": "tail_alphadot_increments",
    "CLP CALCULATIONS ARE ONLY THE VERTICAL TAIL": "vertical_tail_CLP",
    "OUTPUT REFLECTS EXPERIMENTAL DATA INPUTS": "experimental_data",
    "DO NOT INCLUDE THE EFFECTS OF TWIN VERTICAL PANELS": "twin_panels_left_out",
    "THE HORIZONTAL TAIL LIES OFF THE BODY": "tail_off_body",
    "CANARD CONFIGURATION": "canard",
    "GROUND EFFECT ANALYSIS IS PERFORMED": "ground_beyond_linear",
    "CRANKED WING ANALYSIS": "cranked_wing",
    "DOUBLE DELTA WING ANALYSIS": "double_delta",
    "ANALYSIS TERMINATED AT ALPHA": "shock_detached",
    "METHODS VALID FOR CONFIGURATIONS WITH LEADING(HINGE LINE)": "controls_ahead_of_mach_lines",
    "DERIVATIVES ARE FOR STRAIGHT SIDED SYMMETRICAL": "biconvex_airfoils",
    "LACK OF CONTROL MOMENT": "trim_lack_of_moment",
    "EXCEEDS ALPHA (CL) MAX": "trim_past_maximum_lift",
    "MOMENT DATA WAS UNAVAILABLE": "trim_without_wing_body_moment",
}
# kind of group, label, and where the number stands
_NUMBERS = (
    ("weight", "VEHICLE WEIGHT", re.compile(r"VEHICLE WEIGHT = *(\S+) *(LB|N)?\b")),
    (
        "weight",
        "LEVEL FLIGHT LIFT COEFFICIENT",
        re.compile(r"LEVEL FLIGHT LIFT COEFFICIENT = *(\S+)()"),
    ),
    ("note", "CD0", re.compile(r"\*\*  CD0= *(\S+)()")),
    (
        "note",
        "ANALYSIS TERMINATED AT ALPHA",
        re.compile(r"ANALYSIS TERMINATED AT ALPHA= *([-+.\d*]+)()"),
    ),
    ("note", "SCALE FACTOR", re.compile(r"SCALE FACTOR IS *(\S+)()")),
)
_UNITS = {"LB": "lbf", "N": "N", "ANALYSIS TERMINATED AT ALPHA": "deg"}
NAMES = ("weight", "note")
"""Kinds of group that `read_footnote_number` returns."""


def strip_control_column(line: str) -> str:
    """Return the words of a line; two footnotes of the dynamic page start in the control column."""
    return line.strip() if line.startswith("**") else line[1:].strip()


def is_continuation(words: str) -> bool:
    """Return whether a line goes on with the footnote or message before it."""
    return words.startswith(_CONTINUED)


def sort_of(words: str) -> str:
    """Return ``message`` or ``note`` for the first line of one, and an empty text for any other
    line.
    """
    if words.startswith(_MESSAGES) or _BLOWN in words:
        return "message"
    return "note" if _FOOTNOTES.match(words) and words.strip("*") else ""


def list_footnote_words(texts: list[str]) -> list[str]:
    """Return the words of `FOOTNOTE_WORDS` for the notes of a page."""
    return [word for phrase, word in _WORDS_OF.items() if any(phrase in text for text in texts)]


def read_footnote_number(number: int, words: str) -> Values | None:
    """Return the number of a footnote, None when it has none."""
    for name, label, pattern in _NUMBERS:
        if found := pattern.search(words):
            return make_values(name, [(number, label, found[1], _UNITS.get(found[2] or label, ""))])
    return None
