"""The verb ``aeromatch flight engine``: governor, spools, static thrust and starting from the records of an engine."""

from __future__ import annotations

from pathlib import Path

import click

from flightmech.support.console import InputFile, NewFile, document, json_option, progress

from ..options import names_option

_FILE = InputFile()


@click.command("engine")
@click.argument("power_changes", nargs=-1, type=_FILE)
@names_option
@click.option(
    "--flights", "whole", is_flag=True, help="POWER_CHANGES are whole flights: power changes are cut out of them, tables estimated."
)
@click.option("--structure", "structure_file", type=_FILE, help="TOML file of what the tables depend on: limits, fan, over, tables ...")
@click.option("--compare", "compared", multiple=True, type=_FILE, help="Further record that the deck is compared with.")
@click.option("--start", "starts", multiple=True, type=_FILE, help="Record of a start and shut-down.")
@click.option("--points", "points_file", type=_FILE, help="CSV of settled points with recorded thrust: n1 mach h thrust, SI.")
@click.option("--climbs", "climbs_file", type=_FILE, help="CSV of climbs and level accelerations: n1 mach h mass V V_dot h_dot CL, SI.")
@click.option("--prior", "prior_file", type=_FILE, help="A-priori deck, netCDF, or that of the first engine of an aircraft file.")
@click.option("--polar", type=float, nargs=2, help="CD0 and K of the drag polar, for --climbs.")
@click.option("--polar-stderr", type=float, nargs=2, default=(0.0, 0.0), help="Standard errors of CD0 and K; zero holds them.")
@click.option("--area", type=float, default=0.0, help="Reference area [m2], for --climbs.")
@click.option(
    "--engine", "numbers", type=int, multiple=True, default=(1,), help="Engines of the records, averaged; and sharing the climbs."
)
@click.option("--pla", type=float, nargs=2, help="Lever angles of idle and full power [deg], where the records have angles.")
@click.option("--rate", type=float, default=25.0, show_default=True, help="Samples of the records per second.")
@click.option("-o", "--output", type=NewFile(), help="Write the deck; its entry in the aircraft file is printed.")
@json_option
def engine(
    power_changes, names, whole, structure_file, compared, starts, points_file, climbs_file, prior_file, polar, polar_stderr, area, numbers,
    pla, rate, output, as_json,
):  # fmt: skip
    """Identify an engine from POWER_CHANGES (chops, slams, steps that begin at rest), starts, settled points, and whole flights."""
    import numpy as np

    from ...engine.records import engine_channels, read_points
    from ...engine.result import comparison_text, identify_engine
    from ...engine.steady.static import Polar
    from ...engine.structure import EngineStructure, read_structure
    from ...records.record import read
    from ...signals.conditioning import cut

    angles = tuple(np.radians(pla)) if pla else None
    structure = read_structure(structure_file) if structure_file else EngineStructure()

    def channels(path: str):
        record = read(path, names)
        clocks = [leaf.to_dataset()["time"].values for leaf in record.children.values()]
        begin, end = max(float(clock[0]) for clock in clocks), min(float(clock[-1]) for clock in clocks)
        return engine_channels(cut(record, begin, end, rate=rate), numbers, angles, structure.height).assign_attrs(record=Path(path).stem)

    with progress("read the records of the engine"):
        flown = [channels(path) for path in power_changes]
        started = [channels(path) for path in starts]
    with progress("identify the engine"):
        found = identify_engine(
            () if whole else flown,
            started,
            read_points(points_file) if points_file else None,
            read_points(climbs_file) if climbs_file else None,
            _tables(Path(prior_file)) if prior_file else None,
            Polar(*polar, *polar_stderr) if polar else None,
            area,
            len(numbers),
            flights=flown if whole else (),
            **structure.keywords(),
        )
    entry = found.write(output, angles or (0.0, 1.0)) if output else None
    other = [channels(path) for path in compared]
    against = found.compare([*(flown if whole else ()), *other], angles or (0.0, 1.0)) if whole or other else None
    if as_json:
        rows = against.to_dataframe().to_dict("index") if against is not None else {}
        document(found.as_dict() | {"file": output, "compared": rows})
        return
    click.echo(found.report())
    if against is not None:
        click.echo(f"\n{comparison_text(against)}")
    if entry:
        click.echo(f"\nwritten: {output}; in the aircraft file, below [[engine]]:\n\n{entry}")


def _tables(path: Path):
    """Tables of an a-priori deck."""
    from flightmech import read_aircraft
    from flightmech.aircraft.systems.engine_deck import open_tables

    if path.suffix != ".toml":
        return open_tables(path)
    engines = read_aircraft(path).engines
    if not engines or engines[0].deck is None:
        raise click.UsageError(f"{path}: the first engine has no deck; give a deck file, or an aircraft with [engine.deck]")
    return dict(engines[0].deck.tables)
