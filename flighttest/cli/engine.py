"""The verb ``aeromatch flight engine``: governor, spools, static thrust and starting from the records of an engine."""

from __future__ import annotations

from pathlib import Path

import click

from flightmech.support.console import NewFile, document, json_option

from .options import names_option

_FILE = click.Path(exists=True, dir_okay=False)


@click.command("engine")
@click.argument("power_changes", nargs=-1, type=_FILE)
@names_option
@click.option("--start", "starts", multiple=True, type=_FILE, help="Record of a start and shut-down.")
@click.option("--points", "points_file", type=_FILE, help="CSV of settled points with recorded thrust: n1 mach h thrust, SI.")
@click.option("--climbs", "climbs_file", type=_FILE, help="CSV of climbs and level accelerations: n1 mach h mass V V_dot h_dot CL, SI.")
@click.option("--prior", "prior_file", type=_FILE, help="A-priori deck, netCDF.")
@click.option("--polar", type=float, nargs=2, help="CD0 and K of the drag polar, for --climbs.")
@click.option("--polar-stderr", type=float, nargs=2, default=(0.0, 0.0), help="Their standard errors; zero holds them.")
@click.option("--area", type=float, default=0.0, help="Reference area [m2], for --climbs.")
@click.option(
    "--engine", "numbers", type=int, multiple=True, default=(1,), help="Engines of the records, averaged; and sharing the climbs."
)
@click.option("--pla", type=float, nargs=2, help="Lever angles of idle and full power [deg], where the records have angles.")
@click.option("--rate", type=float, default=25.0, show_default=True, help="Samples of the records per second.")
@click.option("-o", "--output", type=NewFile(), help="Write the deck; its entry in the aircraft file is printed.")
@json_option
def engine(
    power_changes, names, starts, points_file, climbs_file, prior_file, polar, polar_stderr, area, numbers, pla, rate, output, as_json
):
    """Identify an engine from POWER_CHANGES (chops, slams, steps that begin at rest), starts, and settled points."""
    import numpy as np

    from flightmech.aircraft.systems.engine_deck import open_tables

    from ..engine.records import engine_channels, read_points
    from ..engine.result import identify_engine
    from ..engine.steady.static import Polar
    from ..records.record import read
    from ..signals.conditioning import cut

    angles = tuple(np.radians(pla)) if pla else None

    def channels(path: str):
        record = read(path, names)
        clocks = [leaf.to_dataset()["time"].values for leaf in record.children.values()]
        begin, end = max(float(clock[0]) for clock in clocks), min(float(clock[-1]) for clock in clocks)
        return engine_channels(cut(record, begin, end, rate=rate), numbers, angles).assign_attrs(record=Path(path).name)

    found = identify_engine(
        [channels(path) for path in power_changes],
        [channels(path) for path in starts],
        read_points(points_file) if points_file else None,
        read_points(climbs_file) if climbs_file else None,
        open_tables(Path(prior_file)) if prior_file else None,
        Polar(*polar, *polar_stderr) if polar else None,
        area,
        len(numbers),
    )
    entry = found.write(output, angles or (0.0, 1.0)) if output else None
    if as_json:
        document(found.as_dict() | {"file": output})
        return
    click.echo(found.report())
    if entry:
        click.echo(f"\nwritten: {output}; in the aircraft file, below [[engine]]:\n\n{entry}")
