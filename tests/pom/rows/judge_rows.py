"""Judge every entry of Table A2A of 2014: the cases of the demo, and those of ``cases/`` with the
final model of the demo.

``python tests/pom/rows/judge_rows.py DEMO`` writes ``verdicts.csv`` from the output folder of
`aeromatch demo`; the page ``tolerance-rows.md`` of the site is made of it
(``docs/scripts/make_tolerance_rows.py``).
"""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Container, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import aerodb
import flightmech
from pom.cases.case import read_case
from pom.checking.report_checks import with_report_checks
from pom.replaying.batch import replay_all
from pom.status import DEPARTURES

HERE = Path(__file__).parent
CASES = HERE / "cases"
SHIPPED = HERE.parents[2] / "data" / "t37" / "cases" / "more"  # shipped, and not in the demo
TABLE = HERE / "verdicts.csv"
COLUMNS = ("entry", "case", "record", "status", "judged", "reason")
JUDGED = ("pass", "fail", "advisory", "invalid")
PEDAL_STEERING = ("2.a.5",)
"""Entries of an aeroplane whose pedals turn the nose wheel, which the nose wheel of the T-37's
records does not show.
"""


def read_table() -> list[dict[str, str]]:
    """Return the rows of ``verdicts.csv``."""
    with TABLE.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def judged(demo: Path, names: Container[str] | None = None) -> list[dict[str, str]]:
    """Return the rows of the table from the output folder of the demo; of the cases `names` only if
    given.
    """
    return [*demo_rows(demo), *own_rows(demo, names)]


def demo_rows(demo: Path) -> list[dict[str, str]]:
    results = json.loads((demo / "report" / "results.json").read_text(encoding="utf-8"))["results"]
    return [
        _row(
            item["case"],
            item["status"]["final"],
            [row for row in item["verdict"] if row["run"] == "final"],
        )
        for item in results
    ]


def own_rows(demo: Path, names: Container[str] | None = None) -> list[dict[str, str]]:
    found = [
        read_case(file) for folder in (CASES, SHIPPED) for file in sorted(folder.glob("*.toml"))
    ]
    found = [case for case in found if names is None or case.name in names]
    rows = []
    with TemporaryDirectory() as folder:
        models = {"": demo / "final.fmu", "steered": _steered(demo, Path(folder))}
        for kind, model in models.items():
            cases = [case for case in found if (case.id in PEDAL_STEERING) == (kind == "steered")]
            results = with_report_checks(replay_all(cases, {"final": model}))
            for case, result in zip(cases, results, strict=True):
                rows.append(
                    _row(
                        case.to_dict(),
                        result.status("final"),
                        result.verdict.reset_index().to_dict("records"),
                    )
                )
    return rows


def _steered(demo: Path, folder: Path) -> Path:
    """Write the final model with a nose wheel that follows the rudder."""
    craft = flightmech.read_aircraft(demo / "final.toml")
    steering = replace(craft.gear.steering, rudder=0.25)
    linked = replace(craft, gear=replace(craft.gear, steering=steering))
    file = folder / "final_pedal_steering.fmu"
    flightmech.write_fmu(flightmech.compile(linked, aerodb.open(demo / "final.nc")), file)
    return file


def _row(
    case: Mapping[str, Any], status: str, verdicts: Iterable[Mapping[str, Any]]
) -> dict[str, str]:
    verdicts = list(verdicts)
    counted = [row for row in verdicts if row["verdict"] in JUDGED]
    stated: list[str] = []
    if status == "not_tested":
        applying = {item["name"] for item in case["criteria"] if item["applies"]}
        missing = [row for row in verdicts if row["criterion"] in applying]
        for row in missing:
            stated += _texts(row, ("reason",)) if row["verdict"] == "not_tested" else []
    elif status == "pass_with_departures":
        for row in verdicts:
            stated += _texts(row, DEPARTURES)
    reasons = [text.removeprefix("departure: ") for text in dict.fromkeys(stated)]
    notes = str(case["notes"])
    if status != "pass" and notes:
        reasons.append(notes)
    return {
        "entry": case["id"],
        "case": case["name"],
        "record": Path(case["record"]).stem,
        "status": status,
        "judged": "; ".join(f"{row['criterion']} {row['verdict']}" for row in counted),
        "reason": "; ".join(reasons),
    }


def _texts(row: Mapping[str, Any], kinds: Container[str]) -> list[str]:
    remarks = [item if isinstance(item, Mapping) else item.as_dict() for item in row["remarks"]]
    return [item["text"] for item in remarks if item["kind"] in kinds]


def order(entry: str) -> list[str]:
    """Return a key that sorts 2.c.9 before 2.c.10."""
    return [part.zfill(3) if part.isdigit() else part for part in entry.split(".")]


def write(demo: Path) -> None:
    rows = sorted(judged(demo), key=lambda row: (order(row["entry"]), row["record"], row["case"]))
    with TABLE.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
