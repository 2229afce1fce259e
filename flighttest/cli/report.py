"""The verbs ``aeromatch flight report | modes``: a whole flight against its bounds, and one eigenmotion."""

from __future__ import annotations

import click

from flightmech.support.atomic_write import write_text
from flightmech.support.console import InputFile, NewFile, document, json_option, progress, table

from .options import names_option


@click.command()
@click.argument("plan_file", metavar="PLAN", type=InputFile())
@click.option("-o", "--output", type=NewFile(), help="Write one self-contained HTML page.")
@click.option("--save", "folder", type=click.Path(file_okay=False), help="Folder for record, paths and fits as netCDF.")
@json_option
@click.pass_context
def report(ctx: click.Context, plan_file: str, output: str | None, folder: str | None, as_json: bool) -> None:
    """Evaluate a flight as specified in PLAN (TOML); exit code 1 when a figure is outside its bounds or not determined."""
    from ..evaluation.flight_evaluation import evaluate
    from ..evaluation.page import page

    with progress("evaluate the flight"):
        found = evaluate(plan_file)
    files = [str(file) for file in found.save(folder)] if folder else []
    if output:
        write_text(output, page(found))
        files.append(output)
    if as_json:
        document({**found.as_dict(), "files": files})
    else:
        click.echo(found.report())
        for file in files:
            click.echo(f"written: {file}")
    ctx.exit(0 if found.passed else 1)


@click.command()
@click.argument("record_file", metavar="RECORD", type=InputFile())
@click.argument("start", type=float)
@click.argument("stop", type=float)
@names_option
@click.option("--channel", "channels", multiple=True, required=True, help="Channel that shows the motion; once for each.")
@click.option("--input", "inputs", multiple=True, help="Control that moves in the window; once for each.")
@click.option("--aperiodic", is_flag=True, help="A real root, as roll and spiral, and not an oscillation.")
@click.option("--level", is_flag=True, help="A constant under each channel and no straight line.")
@json_option
@click.pass_context
def modes(ctx, record_file, start, stop, names, channels, inputs, aperiodic, level, as_json) -> None:
    """Fit one eigenmotion to a record from START to STOP [s]; exit code 1 when its figures must not be used."""
    import warnings

    from flightmech.errors import AeromatchWarning

    from ..aircraft_properties.eigenmotion import fit_motion
    from ..quality.assessment import assess
    from ..records.record import channels as homes
    from ..records.record import read
    from ..remarks import barred, documents, lines
    from ..signals.conditioning import cut

    with progress("read and check the record"):
        record = read(record_file, names)
        quality = assess(record)
    home = homes(record)
    rates = [float(record[home[name]].attrs["rate"]) for name in (*channels, *inputs) if name in home]
    for finding in quality.findings:
        if finding.severity == "error" and set(finding.channels) & {*channels, *inputs}:
            warnings.warn(f"{finding.name}: {finding.text}", AeromatchWarning, stacklevel=1)
    data = cut(record, start, stop, rate=min(rates, default=50.0))
    with progress("fit the motion"):
        found = fit_motion(data, channels, "aperiodic" if aperiodic else "oscillation", inputs, not level)
    test = {"F": found.F, "F_terms": found.F_terms, "F_dof": found.F_dof, "F_probability": found.F_probability}
    if as_json:
        values = {name: dict(zip(("value", "stderr", "unit"), row)) for name, row in found.values.items()}
        document(
            {
                "kind": found.kind,
                "channels": channels,
                "inputs": inputs,
                "share": found.share,
                **values,
                **test,
                "remarks": documents(found.remarks),
            }
        )
        ctx.exit(1 if barred(found.remarks) else 0)
    rows = [(name, f"{value:.5g}", f"{stderr:.2g}", "" if unit == "1" else unit) for name, (value, stderr, unit) in found.values.items()]
    title = f"{found.kind} in {' '.join(channels)}, {start:g} ... {stop:g} s, {found.share:.1%} of the movement explained"
    table(["figure", "estimate", "std error", "unit"], rows, title, right=["estimate", "std error"])
    click.echo(f"amplitudes: F({found.F_terms}, {found.F_dof:.0f}) {found.F:.4g}, probability {found.F_probability:.2g}")
    for line in lines(found.remarks):
        click.echo(line)
    ctx.exit(1 if barred(found.remarks) else 0)
