"""The command group ``aeromatch db``: build, show, compare and check aero databases."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from flightmech.support.console import (
    InputFile,
    LazyGroup,
    NewFile,
    json_option,
    performed_by,
)

if TYPE_CHECKING:
    from datcom_io.reading.reader import ListingCase


class ListingPath(click.ParamType):  # type: ignore[type-arg]
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


_LISTING = InputFile()
_ELSEWHERE = {
    "characteristics": "characteristics",
    "coefficients": "estimates",
    "compare": "compare",
    "edit": "edit",
    "envelope": "envelope",
    "estimate": "estimates",
    "export": "exchange",
    "figures": "compare",
    "history": "edit",
    "import-aircraft": "exchange",
    "import": "exchange",
    "plot": "compare",
    "previous": "edit",
    "forget": "edit",
    "from-estimate": "estimates",
    "rescale": "characteristics",
    "scheme": "characteristics",
}  # verb: module


@click.group(cls=LazyGroup, package=__package__, elsewhere=_ELSEWHERE)
def db() -> None:
    """Build, show and compare aero databases."""


@db.command("build")
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
@click.option(
    "--take",
    multiple=True,
    metavar="TERM=SOURCE",
    help="Take a term from one source in place of a blend: 'Cn/*=AVL'.",
)
@click.option(
    "--errors",
    type=click.Choice(["guide", "calibrated"]),
    default="guide",
    help="Standard errors of the guide (default), or calibrated on published derivatives, with the "
    "bias of the program removed.",
)
@click.option("-o", "--output", required=True, type=NewFile(), help="The database, netCDF-4.")
@json_option
@performed_by("aerodb.cli.actions.group:run_build")
def build_command() -> None:
    """Build a database from the listings of AIRCRAFT (a TOML file), and from other sources.

    PLACES are listings (FILE, FILE:CASE) and folders of listings, such as `datcom run` left: what
    each case is (clean, flaps, elevator, aileron, ground, power ...) is found from its cards and
    headings, and printed. AIRCRAFT may be a folder that holds aircraft.toml and the listings. The
    options give the role instead; one given twice takes several files. CASE is a number, a name or
    a part of a name.

    PLACES may also be a-priori databases, such as of `db from-estimate`. Terms of several sources
    are blended by the covariance of their errors, and what each states is printed and kept in the
    history. A term that only one source has is taken from it.
    """


@db.command("show")
@click.argument("file", type=_LISTING)
@click.option("--term", help="One term with its numbers, such as CL/basic.")
@json_option
@performed_by("aerodb.cli.actions.show:print_database")
def show_database_command() -> None:
    """Show what a database holds, or the numbers of one term."""


@db.command("decisions")
@click.argument("file", type=_LISTING)
@json_option
@performed_by("aerodb.cli.actions.group:run_decisions")
def decisions_command() -> None:
    """Show what the flights decided about each term: replace, correct, keep or delete (not
    identifiable), and why.
    """


@db.command("check")
@click.argument("file", type=_LISTING)
@click.option(
    "--aircraft",
    type=InputFile(),
    help="Aircraft file: its mass for the manoeuvre margin, its reasons for unusual values.",
)
@json_option
@performed_by("aerodb.cli.actions.group:check_database")
def check_database_command() -> None:
    """Check a database file and the plausibility of its numbers.

    Every problem of the file is listed, with exit code 2. Signs and sizes of the derivatives are
    compared with ranges at every Mach number; an implausible value has exit code 1 unless the
    aircraft file acknowledges it with a reason.
    """
