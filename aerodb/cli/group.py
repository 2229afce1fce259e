"""The command group ``aeromatch db``: build, show, compare and check aero databases."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flightmech.support.console import (
    InputFile,
    LazyGroup,
    NewFile,
    json_option,
    print_json,
    print_remark,
    print_table,
    show_progress,
)

if TYPE_CHECKING:
    from aerodb.prior.roles import CaseRole
    from datcom_io.reading.reader import ListingCase


class ListingPath(click.ParamType):
    """FILE, or FILE:CASE for one case of a listing that holds several."""

    name = "FILE[:CASE]"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> ListingCase:
        """Return file and case, empty for all cases."""
        from datcom_io.reading.reader import place_of

        try:
            return place_of(str(value))
        except FileNotFoundError as error:
            self.fail(f"{value!r}: {error.strerror}", param, ctx)


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
    from datcom_io.reading.reader import listings_in, read, read_place

    return [
        item
        for place in places
        for item in (map(read, listings_in(place)) if Path(place).is_dir() else [read_place(place)])
    ]


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


_LISTING = InputFile()
_ELSEWHERE = {
    "characteristics": "characteristics",
    "compare": "compare",
    "edit": "edit",
    "export": "exchange:export_database",
    "figures": "compare",
    "history": "edit",
    "import-aircraft": "exchange",
    "import": "exchange:import_database",
    "plot": "compare",
    "previous": "edit",
    "forget": "edit",
    "rescale": "characteristics",
    "scheme": "characteristics",
}  # verb: module, and the function where it has another name


@click.group(cls=LazyGroup, package=__package__, elsewhere=_ELSEWHERE)
def db() -> None:
    """Build, show and compare aero databases."""


@db.command()
@click.argument("aircraft", type=click.Path(exists=True))
@click.argument("places", nargs=-1)
@click.option(
    "--clean", multiple=True, type=ListingPath(), help="Whole aeroplane, static and dynamic pages."
)
@click.option("--flaps", multiple=True, type=ListingPath(), help="SYMFLP on the wing.")
@click.option(
    "--elevator",
    multiple=True,
    type=ListingPath(),
    help="SYMFLP on the tail, one condition per program run.",
)
@click.option("--aileron", multiple=True, type=ListingPath(), help="ASYFLP with ailerons.")
@click.option("--ground", multiple=True, type=ListingPath(), help="GRNDEF, whole aeroplane.")
@click.option("--ground-flap", multiple=True, type=ListingPath(), help="GRNDEF with flap settings.")
@click.option(
    "--ground-elevator", multiple=True, type=ListingPath(), help="GRNDEF with elevator deflections."
)
@click.option(
    "--power",
    multiple=True,
    type=ListingPath(),
    help="JETPWR or PROPWR, at the Mach numbers of the clean listing.",
)
@click.option("--spoilers", multiple=True, type=ListingPath(), help="ASYFLP with spoilers.")
@click.option(
    "--differential-tail",
    multiple=True,
    type=ListingPath(),
    help="ASYFLP with the halves of the stabilizer.",
)
@click.option("--tabs", multiple=True, type=ListingPath(), help="CONTAB with SYMFLP on the tail.")
@click.option(
    "--aileron-hinge",
    multiple=True,
    type=ListingPath(),
    help="SYMFLP on the wing with the geometry of the aileron.",
)
@click.option(
    "--altitude",
    help="Altitude of the basic tables, such as '10000 ft'; the middle one unless given.",
)
@click.option(
    "--powered",
    is_flag=True,
    help="Use clean pages with JETPWR or PROPWR: thrust taken off, standard errors widened.",
)
@click.option(
    "--tailless",
    is_flag=True,
    help="The aircraft has no tail: pages of a wing-body are those of the whole aeroplane.",
)
@click.option(
    "--move-reference",
    is_flag=True,
    help="Transfer moments by more than 0.1 chord to the reference of the aircraft file.",
)
@click.option("-o", "--output", required=True, type=NewFile(), help="The database, netCDF-4.")
@json_option
def build(
    aircraft: str,
    places: tuple[str, ...],
    altitude: str | None,
    powered: bool,
    tailless: bool,
    move_reference: bool,
    output: str,
    as_json: bool,
    **listings: tuple[ListingCase, ...],
) -> None:
    """Build a database from the listings of AIRCRAFT (a TOML file).

    PLACES are listings (FILE, FILE:CASE) and folders of listings, such as `datcom run` left: what
    each case is (clean, flaps, elevator, aileron, ground, power ...) is found from its cards and
    headings, and printed. AIRCRAFT may be a folder that holds aircraft.toml and the listings. The
    options give the role instead; one given twice takes several files. CASE is a number, a name or
    a part of a name.
    """
    import warnings

    from aerodb.prior.build import from_datcom
    from aerodb.prior.roles import assign_roles, by_role
    from aerodb.store.files import save
    from aerodb.store.overview import describe_database, summary
    from datcom_io.reading.reader import read_place
    from flightmech.aircraft.aircraft import read_aircraft
    from flightmech.errors import AeromatchWarning
    from flightmech.units import parse_quantity

    file, folders = aircraft_and_places(aircraft, places)
    craft = read_aircraft(file)
    given: dict[str, Any] = {
        role: [read_place(place) for place in found] for role, found in listings.items() if found
    }
    assigned = assign_roles(read_all(folders)) if folders else []
    rows = role_rows(assigned, given)
    given = {**by_role(assigned), **given}
    if rows and not as_json:
        print_table(["file", "no", "case", "taken as", "why"], rows, right=["no"])
        click.echo()
    if "clean" not in given:
        raise click.UsageError(
            "no case of the whole aeroplane (clean); give one with --clean FILE:CASE, or "
            "PLACES that hold one"
        )
    count = sum(map(len, given.values()))
    with (
        show_progress(f"build a database from {count} cases"),
        warnings.catch_warnings(record=True) as caught,
    ):
        warnings.simplefilter("always", AeromatchWarning)
        tree = from_datcom(
            craft,
            altitude=None if altitude is None else parse_quantity(altitude, "m"),
            powered=powered,
            tailless=tailless,
            move_reference=move_reference,
            **given,
        )
    messages = [
        str(warning.message) for warning in caught if issubclass(warning.category, AeromatchWarning)
    ]
    save(tree, output)
    for text in messages:
        print_remark(f"warning: {text}")
    if as_json:
        print_json(
            {
                "file": output,
                "attributes": tree.attrs,
                "terms": describe_database(tree),
                "roles": rows,
                "warnings": messages,
            }
        )
    else:
        click.echo(summary(tree))
        click.echo(f"\nwritten: {output}")


@db.command()
@click.argument("file", type=_LISTING)
@click.option("--term", help="One term with its numbers, such as CL/basic.")
@json_option
def show(file: str, term: str | None, as_json: bool) -> None:
    """Show what a database holds, or the numbers of one term."""
    if term is None:
        attributes, rows = _overview(file)
        if as_json:
            print_json({"attributes": attributes, "terms": rows})
        else:
            from aerodb.store.overview import summary_text

            click.echo(summary_text(attributes, rows))
    elif as_json:
        _term_document(file, term)
    else:
        _print_term(file, term)


def _overview(file: str) -> tuple[Mapping[str, Any], list[dict[str, Any]]]:
    """Return the root attributes and a row per term, from the overview that a sealed file carries
    where it has one.
    """
    from aerodb.store.overview import OVERVIEW
    from aerodb.store.seal import read_database_seal

    whole = read_database_seal(Path(file))
    if found := whole.overview(OVERVIEW):
        attributes, rows = found
        return attributes, rows
    from aerodb.store.files import list_terms

    return list_terms(file, whole)


def _print_term(file: str, term: str) -> None:
    """Print the numbers of one term."""
    from aerodb.store.files import read_overview
    from aerodb.store.overview import leaf_rows
    from flightmech.errors import UnknownName
    from flightmech.terms import power_factor

    _, leaves = read_overview(file, ["value"], names=[term])
    if term not in leaves:
        raise UnknownName(term, read_overview(file, ["value"])[1], "term")
    leaf = leaves[term]
    head, rows = leaf_rows(leaf)
    print_table(head, rows, title=term, right=head)
    texts = {
        key: leaf.attrs.get(key)
        for key in ("regressors", "decision", "reason", "comment", "references", "history")
    }
    for key, text in {"power": power_factor(leaf), **texts}.items():
        if text:
            click.echo(f"{key}: {text}")


def _term_document(file: str, term: str) -> None:
    from aerodb.store.files import open
    from aerodb.store.schema import find_leaf
    from aerodb.update.posterior import without_posterior

    print_json({"term": term, **without_posterior(find_leaf(open(file), term)).to_dict()})


@db.command()
@click.argument("file", type=_LISTING)
@json_option
def decisions(file: str, as_json: bool) -> None:
    """Show what the flights decided about each term: replace, correct, keep or delete (not
    identifiable), and why.
    """
    from aerodb.store.files import read_overview
    from aerodb.update.cautions.notices import notices_of
    from aerodb.update.term_decisions import DECISIONS, decision_rows

    attributes, leaves = read_overview(file, ["value", "source"], ["decision", "reason"])
    rows = [
        {"term": name, "decision": decision, "reason": reason}
        for name, (decision, reason) in decision_rows(leaves).items()
    ]
    if as_json:
        print_json({"file": file, "terms": rows, "warnings": notices_of(attributes)})
        return
    print_table(("term", "decision", "reason"), [tuple(row.values()) for row in rows])
    words = [row["decision"] for row in rows]
    click.echo(", ".join(f"{word} {words.count(word)}" for word in DECISIONS))
    for notice in notices_of(attributes):
        click.echo(f"warning: {notice}")


@db.command()
@click.argument("file", type=_LISTING)
@json_option
def check(file: str, as_json: bool) -> None:
    """Check a database file; every problem is listed, exit code 2 when there is any."""
    from aerodb.store.files import open
    from aerodb.store.schema import terms

    tree = open(file)
    count = len(terms(tree))
    print_json({"file": file, "terms": count, "problems": []}) if as_json else click.echo(
        f"{file}: sound, {count} terms"
    )
