"""Functions that perform the commands of `datcom_io.cli.deck`."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import click

from datcom_io.decks.check import check_deck
from datcom_io.decks.deck_file import read_deck, write_deck
from datcom_io.decks.rules_sizes import describe_size
from datcom_io.runs.running import ProgramRun, run_deck, run_folder
from datcom_io.runs.splitting import split_deck
from flightmech.support import console
from flightmech.support.atomic_write import folder_for_files
from flightmech.support.console import count_text


def show_deck(deck: str, output: str | None, resolved: bool, as_json: bool) -> None:
    """Perform the command ``deck``."""
    found = read_deck(deck)
    if output:
        write_deck(found, output, resolved=resolved)
    rows = [_case_row(number, case) for number, case in enumerate(found, 1)]
    if as_json:
        console.print_json(
            {"file": found.file, "cases": rows, **({"written": output} if output else {})}
        )
        return
    head = [
        "no",
        "case",
        "units",
        "conditions",
        "Mach",
        "altitude",
        "alpha [deg]",
        "namelists",
        "cards",
    ]
    console.print_table(
        head,
        [tuple(row.values()) for row in rows],
        title=f"{found.file}: {count_text(len(found), 'case')}",
        right=["no", "conditions"],
    )
    if output:
        click.echo(f"written: {output}")


def _case_row(number: int, case: Any) -> dict[str, Any]:
    machs, heights = (
        case.schedule("FLTCON", "MACH", "NMACH"),
        case.schedule("FLTCON", "ALT", "NALT"),
    )
    return {
        "no": number,
        "case": case.caseid,
        "units": f"{case.dim}, {case.deriv}",
        "conditions": len(case.conditions()),
        "mach": " ".join(f"{x:g}" for x in machs),
        "altitude": " ".join(f"{x:g}" for x in heights),
        "alpha": " ".join(f"{x:g}" for x in case.schedule("FLTCON", "ALSCHD", "NALPHA")),
        "namelists": " ".join(case.namelists),
        "cards": " ".join(
            card.name
            for card in case.cards
            if card.name not in ("CASEID", "DIM", "DERIV", "NACA", "NEXT")
        ),
    }


def run_check_deck(ctx: click.Context, deck: str, as_json: bool) -> None:
    """Perform the command ``check``."""
    read = read_deck(deck)
    found = check_deck(read)
    by_severity = Counter(finding.severity for finding in found)
    numbers = {severity: by_severity[severity] for severity in ("error", "warning", "note")}
    if as_json:
        console.print_json(
            {
                "file": read.file,
                "cases": len(read),
                **numbers,
                "findings": [finding._asdict() for finding in found],
            }
        )
    else:
        for (severity, text), lines in _together(found).items():
            more = f" and {len(lines) - 1} more" if len(lines) > 1 else ""
            click.echo(f"line {lines[0]}{more}: {severity}: {text}")
        counts = ", ".join(
            count_text(number, severity) for severity, number in numbers.items() if number
        )
        sizes = dict.fromkeys(filter(None, map(describe_size, read)))
        click.echo(
            f"{read.file}: "
            + "; ".join([f"{count_text(len(read), 'case')}, {counts or 'nothing found'}", *sizes])
        )
    if numbers["error"]:
        ctx.exit(1)


def _together(found: Any) -> dict[tuple[str, str], list[int]]:
    """Put findings of the same text together."""
    lines: dict[tuple[str, str], list[int]] = {}
    for finding in found:
        lines.setdefault((finding.severity, finding.text), []).append(finding.line)
    return lines


def run_split(study: str, folder: str, as_json: bool) -> None:
    """Perform the command ``split``."""
    decks = split_deck(study)
    with folder_for_files(folder) as place:
        for deck in decks.values():
            write_deck(deck, place / deck.file, resolved=True)
    rows = []
    for name, deck in decks.items():
        case = deck[0]
        devices = " ".join(
            name for name in ("SYMFLP", "ASYFLP", "GRNDEF") if name in case.namelists
        )
        rows.append(
            {
                "run": name,
                "file": str(Path(folder) / deck.file),
                "conditions": len(case.conditions()),
                "devices": devices,
                "caseid": case.caseid,
            }
        )
    if as_json:
        console.print_json({"study": study, "runs": rows})
        return
    console.print_table(
        ["run", "file", "conditions", "devices", "CASEID"],
        [tuple(row.values()) for row in rows],
        right=["conditions"],
    )
    click.echo(f"{count_text(len(rows), 'run deck')} in {folder}")


def run_run_deck(
    ctx: click.Context, deck: str, program: str, folder: str | None, timeout: float, as_json: bool
) -> None:
    """Perform the command ``run``."""
    if folder is not None:
        Path(folder).parent.mkdir(parents=True, exist_ok=True)
    if Path(deck).is_dir():
        _run_folder(ctx, deck, program, folder=folder, timeout=timeout, as_json=as_json)
        return
    with console.show_progress(f"run {Path(deck).name}"):
        done = run_deck(deck, program, folder, timeout=timeout)
    row = _run_row(Path(deck), done)
    if as_json:
        console.print_json(
            {key: row[key] for key in ("files", "cases", "without_pages", "messages", "seconds")}
        )
    else:
        for message in done.messages:
            click.echo(f"line {message.line}: {message.text}")
        cases = (
            f"{count_text(len(done.listing), 'case')}, "
            f"{count_text(len(done.listing.pages), 'page')}"
        )
        click.echo(
            f"{cases} in {done.seconds:.1f} s; written: "
            f"{', '.join(str(path) for path in done.files.values())}"
        )
        for name in row["without_pages"]:
            click.echo(f"case without a page: {name}")
    if row["without_pages"]:
        ctx.exit(1)


def _run_row(deck: Path, done: ProgramRun) -> dict[str, Any]:
    """Return what a run made, of plain numbers and texts."""
    return {
        "deck": deck.name,
        "files": {key: str(path) for key, path in done.files.items()},
        "cases": done.listing.case_names,
        "pages": len(done.listing.pages),
        "without_pages": [case.name for case in done.listing if not case.pages],
        "messages": [message._asdict() for message in done.messages],
        "seconds": done.seconds,
    }


def _run_folder(
    ctx: click.Context, decks: str, program: str, folder: str | None, timeout: float, as_json: bool
) -> None:
    """Run all decks of a folder and print a line for each."""

    rows = []
    with console.show_progress(f"run the decks of {decks}"):
        for deck, done in run_folder(decks, program, folder, timeout=timeout):
            rows.append(
                _run_row(deck, done)
                if isinstance(done, ProgramRun)
                else {"deck": deck.name, "error": str(done)}
            )
    failed = sum("error" in row or bool(row["without_pages"]) for row in rows)
    if as_json:
        console.print_json({"folder": decks, "runs": rows, "failed": failed})
    else:
        head = ["deck", "cases", "pages", "without pages", "messages", "result"]
        console.print_table(
            head,
            [_run_line(row) for row in rows],
            right=["cases", "pages", "without pages", "messages"],
        )
        click.echo(
            f"{count_text(len(rows), 'deck')} run, {failed} with a failure or a case without a page"
            if failed
            else f"{count_text(len(rows), 'deck')} run"
        )
    if failed:
        ctx.exit(1)


def _run_line(row: dict[str, Any]) -> tuple[str, ...]:
    if "error" in row:
        return (row["deck"], "", "", "", "", f"error: {row['error']}")
    counts = (len(row["cases"]), row["pages"], len(row["without_pages"]), len(row["messages"]))
    return (row["deck"], *map(str, counts), row["files"]["out"])
