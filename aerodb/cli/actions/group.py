"""Functions that perform the commands of `aerodb.cli.group`."""

from __future__ import annotations

import math
import warnings
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click
import xarray as xr

from aerodb.edit.joined_sources.prior_blending import PriorBlend, blend_sources
from aerodb.prior.build import from_datcom
from aerodb.prior.roles import CaseRole, assign_roles, by_role
from aerodb.store.files import open as open_database
from aerodb.store.files import save
from aerodb.store.overview import describe_database, summary
from aerodb.store.schema import terms
from aerodb.update.cautions.notices import note_plausibility, notices_of
from aerodb.update.term_decisions import DECISIONS, decision_rows
from datcom_io.reading.reader import ListingCase, listings_in, read, read_place
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import AeromatchWarning
from flightmech.quantities import option_quantity
from flightmech.simulation.model_checks import check_root
from flightmech.support.console import (
    collect_options,
    print_json,
    print_remark,
    print_table,
    show_progress,
)
from flightmech.support.hdf5_seal import SIGNATURE


def aircraft_and_places(aircraft: str, places: tuple[str, ...]) -> tuple[Path, tuple[str, ...]]:
    """Return the aircraft file and the places of the listings; a folder stands for its
    ``aircraft.toml`` and its listings.
    """
    if not Path(aircraft).is_dir():
        return Path(aircraft), places
    file = Path(aircraft) / "aircraft.toml"
    if not file.is_file():
        raise click.UsageError(
            f"no aircraft.toml in the folder {aircraft}; write it, or give the aircraft file "
            f"first and then the folder"
        )
    return file, (aircraft, *places)


def read_all(places: Iterable[str]) -> list[Any]:
    """Return the listings and cases of places, of folders every listing in them."""
    items: list[Any] = []
    for place in places:
        if Path(place).is_dir():
            items += map(read, listings_in(place))
        else:
            items.append(read_place(place))
    return items


def role_rows(
    assigned: Iterable[CaseRole], given: Collection[str]
) -> list[tuple[str, str, str, str, str]]:
    """Return file, number and name of each case, its roles less those that are given by options,
    and why.
    """
    rows = []
    for item in assigned:
        roles = [f"{role} (given otherwise)" if role in given else role for role in item.roles]
        rows.append(
            (
                item.case.file,
                str(item.case.ordinal),
                item.case.name,
                ", ".join(roles) or "-",
                item.reason,
            )
        )
    return rows


@dataclass(frozen=True)
class BuildOptions:
    """Options of a database from DATCOM, as `from_datcom` takes them.

    Attributes
    ----------
    altitude : str or None
        Altitude of the basic tables, with its unit.
    powered, tailless, move_reference : bool
        What the listings may be.
    errors : {"guide", "calibrated"}
        Standard errors.
    """

    altitude: str | None
    powered: bool
    tailless: bool
    move_reference: bool
    errors: str

    def keywords(self) -> dict[str, Any]:
        """Return the keywords of `from_datcom`."""
        keywords = asdict(self)
        if self.altitude is None:
            del keywords["altitude"]
        else:
            keywords["altitude"] = option_quantity("--altitude", self.altitude, "m")
        return keywords


@collect_options(options=BuildOptions)
def run_build(
    aircraft: str,
    places: tuple[str, ...],
    options: BuildOptions,
    take: tuple[str, ...],
    output: str,
    as_json: bool,
    **listings: tuple[ListingCase, ...],
) -> None:
    """Perform the command ``build``."""
    file, found_places = aircraft_and_places(aircraft, places)
    craft = read_aircraft(file)
    others = [open_database(place) for place in found_places if _is_database(place)]
    folders = [place for place in found_places if not _is_database(place)]
    # Roles that the options state come before those that the cards of the cases show.
    stated: dict[str, Any] = {}
    for role, listing_cases in listings.items():
        if listing_cases:
            stated[role] = [read_place(listing_case) for listing_case in listing_cases]
    assigned = assign_roles(read_all(folders)) if folders else []
    rows = role_rows(assigned, stated)
    by_roles = {**by_role(assigned), **stated}
    if rows and not as_json:
        print_table(["file", "no", "case", "taken as", "why"], rows, right=["no"])
        click.echo()
    keywords = options.keywords()
    choices = _read_choices(take, len(others))
    databases, messages = others, list[str]()
    if by_roles or not others:
        tree, messages = _build(craft, by_roles, keywords)
        databases = [tree, *others]
    rows_of_sources: list[dict[str, Any]] = []
    if others:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", AeromatchWarning)
            blend = blend_sources(
                databases, craft, take=choices, move_reference=options.move_reference
            )
        messages += _texts_of(caught)
        tree, rows_of_sources = blend.database, _source_rows(blend)
    save(tree, output)
    for text in messages:
        print_remark(f"warning: {text}")
    if as_json:
        content: dict[str, Any] = {
            "file": output,
            "attributes": tree.attrs,
            "terms": describe_database(tree),
            "roles": rows,
            "warnings": messages,
        }
        if others:
            content["sources"] = rows_of_sources
        print_json(content)
        return
    if others:
        _print_sources(rows_of_sources)
    click.echo(summary(tree))
    click.echo(f"\nwritten: {output}")


def _is_database(place: str) -> bool:
    """Return whether a place is a file of netCDF-4, by its first bytes."""
    try:
        with open(place, "rb") as file:
            return file.read(len(SIGNATURE)) == SIGNATURE
    except OSError:
        return False


def _read_choices(take: Iterable[str], others: int) -> dict[str, str]:
    """Return the source of every term that ``--take`` names."""
    choices = {}
    for text in take:
        term, equals, label = text.partition("=")
        if not equals or not term.strip() or not label.strip():
            raise click.UsageError(f"--take {text!r}: expected TERM=SOURCE such as 'Cn/*=AVL'")
        choices[term.strip()] = label.strip()
    if choices and not others:
        raise click.UsageError("--take chooses among several sources; give databases as PLACES")
    return choices


def _texts_of(caught: Iterable[warnings.WarningMessage]) -> list[str]:
    """Return the texts of the warnings of the package."""
    return [str(item.message) for item in caught if issubclass(item.category, AeromatchWarning)]


def _source_rows(blend: PriorBlend) -> list[dict[str, Any]]:
    """Return one row per term: what each source states, what was taken, how well they agree."""
    rows = []
    for name, row in blend.table.iterrows():
        cells = {str(key): item for key, item in row.items()}
        rows.append(without_missing({"term": str(name), **cells}))
    return rows


def _print_sources(rows: Iterable[Mapping[str, Any]]) -> None:
    """Print what each source of a term states at the node where they differ most."""
    rows = list(rows)
    stderr = " stderr"
    labels: dict[str, None] = {}
    for row in rows:
        labels |= dict.fromkeys(key.removesuffix(stderr) for key in row if key.endswith(stderr))
    cells = []
    for row in rows:
        stated = [
            f"{row[label]:.4g} +- {row[label + stderr]:.2g}" if label in row else ""
            for label in labels
        ]
        agreement = [f"{row[key]:.3g}" if key in row else "" for key in ("chi2", "probability")]
        cells.append([row["term"], *stated, *agreement, row["where"], row["decision"]])
    head = ["term", *labels, "chi-square", "probability", "where", "decision"]
    print_table(head, cells, "sources at the node where they differ most", right=head[1:-2])
    click.echo()


def _build(
    craft: Aircraft, cases: Mapping[str, Any], options: Mapping[str, Any]
) -> tuple[xr.DataTree, list[str]]:
    """Return the database of the cases of all roles, and the warnings of its making."""
    if "clean" not in cases:
        raise click.UsageError(
            "no case of the whole aeroplane (clean); give one with --clean FILE:CASE, or "
            "PLACES that hold one"
        )
    count = sum(map(len, cases.values()))
    with (
        show_progress(f"build a database from {count} cases"),
        warnings.catch_warnings(record=True) as caught,
    ):
        warnings.simplefilter("always", AeromatchWarning)
        tree = from_datcom(craft, **options, **cases)
    return tree, _texts_of(caught)


def run_decisions(file: str, as_json: bool) -> None:
    """Perform the command ``decisions``."""
    db = open_database(file)
    rows = [
        {"term": name, "decision": decision, "reason": reason}
        for name, (decision, reason) in decision_rows(db).items()
    ]
    if as_json:
        print_json({"file": file, "terms": rows, "warnings": notices_of(db.attrs)})
        return
    print_table(("term", "decision", "reason"), [tuple(row.values()) for row in rows])
    words = [row["decision"] for row in rows]
    click.echo(", ".join(f"{word} {words.count(word)}" for word in DECISIONS))
    for notice in notices_of(db.attrs):
        click.echo(f"warning: {notice}")


def check_database(file: str, aircraft: str | None, as_json: bool) -> None:
    """Perform the command ``check``."""
    tree = open_database(file)
    craft = None
    if aircraft is not None:
        craft = read_aircraft(aircraft)
    findings = note_plausibility(tree, craft)[1]
    count = len(terms(tree))
    # a model of both is not compiled, so that the database is not sound for this aircraft
    problems = [] if craft is None else check_root(craft, tree)
    is_implausible = any(finding.stops for finding in findings)
    counts = Counter(finding.kind for finding in findings)
    if problems:
        verdict = "not of this aircraft"
    elif is_implausible:
        verdict = "implausible"
    else:
        verdict = "sound where checked" if counts["not checked"] else "sound"
    if as_json:
        rows = [without_missing(asdict(finding)) for finding in findings]
        content = {"file": file, "terms": count, "verdict": verdict, "problems": problems}
        print_json({**content, "plausibility": rows})
    else:
        parts = [f"{file}: {verdict}", f"{count} terms"]
        for kind in ("missing", "not checked"):
            if counts[kind]:
                parts.append(f"{counts[kind]} {kind}")
        click.echo(", ".join(parts))
        for line in (*problems, *findings):
            click.echo(f"  {line}")
    if problems or is_implausible:
        raise SystemExit(1)


def without_missing(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row without numbers that are NaN or infinite, which JSON does not have."""
    return {
        key: value
        for key, value in row.items()
        if not isinstance(value, float) or math.isfinite(value)
    }
