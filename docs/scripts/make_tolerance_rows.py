"""Page ``tolerance-rows.md``, the entries of Table A2A and the record on which each is judged. The
site has the page (`make_site`); ``python docs/scripts/make_tolerance_rows.py`` prints it.

The verdicts are those of the table of the test, ``tests/pom/rows/verdicts.csv``.
"""

from __future__ import annotations

import runpy
from pathlib import Path

from pom.tolerances import rows

TEST = Path(__file__).parents[2] / "tests" / "pom" / "rows" / "judge_rows.py"
SHOWN = {
    "pass": "pass",
    "fail": "FAIL",
    "invalid": "invalid",
    "not_tested": "not tested",
    "pass_with_departures": "pass with departures",
    "limits_exceeded": "pass with limits exceeded",
    "record_error": "pass on a record with errors",
    "leak": "LEAK: the record identified the model",
    "not_driven": "NOT DRIVEN by the inputs",
    "demonstration": "shown, no tolerance",
}
HEAD = """# Which entry is judged on which record

The {entries} entries of 14 CFR Part 60 App. A Table A2A (2014) and the verdict of the final model
of the T-37 (`aeromatch demo`) on each. Every line is a test, `tests/pom/rows/test_rows.py`.
{judged} entries are judged. {beyond} are not, because the model does not have the quantity. A
judged criterion without a word passes.

Records `t37_NN_...` are those of `data/t37/flight`, with instrument errors. The others are
error-free states of the same aeroplane (`tests/pom/rows/fly_rows.py`). Where a T-37 does not have
what an entry speaks of, the description of the case states the substitute: thrust reversers on its
engines (1.e.2, 2.e.8, 2.e.9), a nose wheel linked to the pedals (2.a.5), protections that are in
the recorded surfaces (2.h).

| entry | | record | verdict | judged | why |
|---|---|---|---|---|---|
"""
TAIL = """
## Outside

| section of Table A2A | why |
|---|---|
| 3, motion system | tests of the motion base: its frequency response, smoothness, repeatability, \
cues; an FMU has no motion base |
| 4, visual system | tests of image generator and display, and the delay of the whole simulator; \
an FMU has neither |
| 5, sound system | sound pressure in the cockpit; the model makes no sound |

The rows of these sections are not in `tolerances.csv`: a proof of match of the mathematical model
cannot test them.
"""


def _judged(text: str) -> str:
    """Return the criteria of an entry; the verdict is written where it is not a pass."""
    criteria = [item.removesuffix(" pass").replace("_", " ") for item in text.split("; ")]
    return ", ".join(criteria)


def page() -> str:
    """Return the text of the page."""
    table = runpy.run_path(str(TEST), run_name="judge_rows")["read_table"]()
    titles = {
        row["test_id"]: row["title"]
        for row in rows.tolerance_rows()
        if (row["standard"], row["edition"]) == (rows.STANDARD, rows.EDITION)
    }
    entries = {row["entry"] for row in table}
    beyond = {row["entry"] for row in table if row["status"] == "not_tested" and not row["judged"]}
    text = HEAD.format(entries=len(entries), judged=len(entries - beyond), beyond=len(beyond))
    for row in table:
        cells = (
            row["entry"],
            titles[row["entry"]],
            f"`{row['record']}`",
            SHOWN[row["status"]],
            _judged(row["judged"]),
            row["reason"],
        )
        text += f"| {' | '.join(cells)} |\n"
    return text + TAIL


if __name__ == "__main__":
    print(page(), end="")
