"""Page ``row-conditions.md``, the conditions that rows of the tolerance table state for the
flight. The site has the page (`make_site`); ``python docs/scripts/make_row_conditions.py`` prints
it.
"""

from __future__ import annotations

from pom.tolerances import rows
from pom.tolerances.channels import plain_id
from pom.tolerances.stated_conditions import CONDITIONS, CONFIGURATIONS, STATED, StatedCondition

HEAD = """# Conditions of the rows

What the rows of `tolerances.csv` require of a flight, and how each condition is evaluated.

A condition that does not hold is a [departure](../explanation/proof-of-match/verdicts.md). So is
one that is *not shown*: record, case or `[facts]` of the
[aircraft file](project-keys.md#aircraft-file) lack what its evaluation needs. A configuration that
is not recorded may be stated in `[conditions]` of the case (`delta_f = "0 deg"`). A condition that
the program does not evaluate is a notice *not checked* in index, terminal and page. Bounds of
windows (`brake_release` ... `200ft_agl`) are events of the case; a window that is shorter is a
departure too. Three kinds of conditions make a case `invalid`: a precondition with a tolerance of
its own (engine failure speed), too few cycles of a mode, a snapshot that is not steady.

| tests | condition | how it is evaluated | over |
|---|---|---|---|
"""
CONFIGURATION_HEAD = """
## Configurations

`clean`: flaps in, gear up. `extended`: flaps out. `landing`: flaps out, gear down. `takeoff`: flaps
not full, gear down. `ground`: on the wheels. A gear without positions in
`[limits]` of the aircraft file is a fixed one. Of
several configurations one is enough; the others are the coverage of the report.

| flight condition of the row | evaluated as | tests |
|---|---|---|
"""
CLAIM_HEAD = """
## Conditions in the column `condition`

| condition | evaluated from |
|---|---|
| `reversible_controls` | `[facts]` of the aircraft file; unknown: a departure that names the rows \
left out |
| `groundspeed...`, `speed>...` | samples of the record: `vn`, `ve`; `V_cas` at the first of \
`stall_warning` and `initial_buffet` |
| `distance...` | the run of the flight picks the row |
| `underdamped`, `overdamped` | the free motion in the record |
| `approach_to_stall`, `warning_to_stall`, `stall_break_and_recovery`, `before_g_break` | \
`stall_warning`, `stall`, `g_break` in `[events]` |
| every other word | the case, in `features`; stated as *not checked* |
"""


def _tests_of(name: str) -> str:
    if name == "configuration":
        return "all"
    return ", ".join(test for test, names in STATED.items() if name in names)


def _line(item: StatedCondition) -> str:
    how = item.how or "*not checked*"
    return f"| {_tests_of(item.name)} | {item.text} | {how} | {item.over} |"


def page() -> str:
    """Return the text of the page."""
    lines = [_line(item) for item in CONDITIONS.values()]
    tests: dict[str, dict[str, None]] = {}
    for row in rows.tolerance_rows():
        tests.setdefault(row["flight_condition"], {})[plain_id(row["test_id"])] = None
    configurations = []
    for words, names in tests.items():
        allowed = " or ".join(f"`{name}`" for name in CONFIGURATIONS.get(words, ()))
        shown = words.replace("_", " ").replace(";", ", ")
        configurations.append(f"| {shown} | {allowed or '*not checked*'} | {', '.join(names)} |")
    body = "\n".join(lines) + "\n" + CONFIGURATION_HEAD + "\n".join(configurations) + "\n"
    return HEAD + body + CLAIM_HEAD


if __name__ == "__main__":
    print(page(), end="")
