"""The verb ``aeromatch flight fit``: parameters of the simulation by output error, from a TOML file."""

from __future__ import annotations

import click

from flightmech.support.atomic_write import write_text
from flightmech.support.console import InputFile, NewFile, document, json_option, progress


@click.command()
@click.argument("fit_file", metavar="FIT", type=InputFile())
@click.option("-o", "--output", type=NewFile(), help="Write estimates, noise and residuals to this netCDF file.")
@click.option("--page", type=NewFile(), help="Write one self-contained HTML page: estimates, and measured and predicted outputs.")
@click.option("--database", type=NewFile(), help="Write the database with the estimates in it.")
@json_option
@click.pass_context
def fit(ctx: click.Context, fit_file: str, output: str | None, page: str | None, database: str | None, as_json: bool) -> None:
    """Estimate parameters of the simulation by output error, as specified in FIT (TOML); exit code 1 when a figure must not be used."""
    from ..maximum_likelihood.files import save_output_error
    from ..maximum_likelihood.job.page import page as page_of
    from ..maximum_likelihood.job.run import perform
    from ..maximum_likelihood.job.specification import read_specification
    from ..remarks import barred

    with progress("estimate parameters by output error"):
        done = perform(read_specification(fit_file))
    files: list[str] = []
    left: list[str] = []
    if output:
        save_output_error(done.fit, output)
        files.append(output)
    if page:
        write_text(page, page_of(done))
        files.append(page)
    if database:
        left = done.write_database(database)
        files.append(database)
    if as_json:
        document({**done.as_dict(), "files": files, "not_in_the_database": left})
    else:
        click.echo(done.report())
        for file in files:
            click.echo(f"written: {file}")
        if left:
            click.echo(f"not in the database: {' '.join(left)}")
    ctx.exit(1 if barred([*done.fit.remarks, *done.remarks]) else 0)
