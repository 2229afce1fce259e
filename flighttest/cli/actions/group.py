"""Functions that perform the commands of `flighttest.cli.group`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path as File
from typing import Any, NoReturn

import click

from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import SchemaError
from flightmech.quantities import time_text
from flightmech.support.atomic_write import folder_for_files
from flightmech.support.console import (
    NewFile,
    collect_options,
    count_text,
    print_json,
    print_remark,
    show_progress,
)
from flighttest.reconstruction.batch.programme import reconstruct_batch
from flighttest.reconstruction.compatibility import compatibility_report, draw_compatibility
from flighttest.reconstruction.flight_programme import open_biases, reconstruct_programme, save_path
from flighttest.reconstruction.smoother import reconstruct as reconstruct_record
from flighttest.records.files import save_dataset
from flighttest.records.record import read
from flighttest.records.signals.conditioning import cut as cut_record
from flighttest.remarks import remarks_to_json


def run_cut(
    record_file: str,
    start: float,
    stop: float,
    names: str | None,
    rate: float,
    output: str,
    as_json: bool,
) -> None:
    """Perform the command ``cut``."""
    data = cut_record(read(record_file, names), start, stop, rate)
    save_dataset(data, output)
    about = {
        "file": output,
        "samples": data.sizes["time"],
        "channels": len(data.data_vars),
        **data.attrs,
    }
    if as_json:
        print_json(about)
    else:
        click.echo(
            f"{about['samples']} samples of {about['channels']} channels, {time_text(start)} ... "
            f"{time_text(stop)} s at {rate:g} Hz"
        )
        click.echo(f"written: {output}")


@dataclass(frozen=True)
class ReconstructionOptions:
    """Options of the reconstruction, by the names of `flighttest.cli.group`.

    Attributes
    ----------
    windows : tuple of (float, float)
        Start and stop [s]; without any window, the whole record.
    rate : float
        Samples per second.
    biases_file : str or None
        Reconstructed path whose constants are the prior.
    method : {"smoother", "batch"}
    free : tuple of str
        Constants that the batch estimates, as for `reconstruct_batch`.
    """

    windows: tuple[tuple[float, float], ...]
    rate: float
    biases_file: str | None
    method: str
    free: tuple[str, ...]

    def check(self, record_count: int) -> None:
        """Raise SchemaError for options that exclude each other."""
        if record_count > 1 and (self.windows or self.biases_file):
            _refuse("--window and --biases go with one record; give the records one at a time")
        if self.free and self.method != "batch":
            _refuse("--free goes with --method batch; the smoother estimates all constants")


@collect_options(options=ReconstructionOptions)
def run_reconstruct(
    record_files: tuple[str, ...],
    aircraft_file: str,
    names: str | None,
    options: ReconstructionOptions,
    figure: str | None,
    jobs: int,
    output: str,
    as_json: bool,
) -> None:
    """Perform the command ``reconstruct``."""
    options.check(len(record_files))
    if len(record_files) > 1 and figure:
        _refuse("--figure goes with one record; give the records one at a time")
    windows = list(options.windows) or None
    if len(record_files) == 1:
        NewFile().convert(output, None, click.get_current_context())
    aircraft = read_aircraft(aircraft_file)
    prior = open_biases(options.biases_file) if options.biases_file else None
    with show_progress(f"read {count_text(len(record_files), 'record')}"):
        records = [read(file, names) for file in record_files]
    targets = [File(output)]
    batch = None
    if len(records) > 1 and options.method == "smoother":
        print_remark(
            f"{len(records)} records: each alone, then each with what the others indicate "
            f"about the instruments"
        )
    with show_progress("reconstruct the states"):
        if options.method == "batch":
            batch = reconstruct_batch(
                records,
                aircraft,
                [windows] * len(records),
                free=options.free or None,
                prior=prior,
                rate=options.rate,
            )
            paths = batch.paths
        elif len(records) == 1:
            paths = [reconstruct_record(records[0], aircraft, windows, prior, options.rate)]
        else:
            paths = reconstruct_programme(records, aircraft, options.rate, jobs)
    if len(records) > 1:
        targets = [File(output) / f"{File(file).name.split('.')[0]}.nc" for file in record_files]
    with folder_for_files(targets[0].parent) as place:
        for path, target in zip(paths, targets, strict=True):
            save_path(path, place / target.name)
    if figure:
        draw_compatibility(paths[0], figure)
    if batch is not None and not as_json:
        click.echo(batch.report() + "\n")
    if as_json:
        print_json(_path_documents(paths, targets, batch))
        return
    for path, target in zip(paths, targets, strict=True):
        click.echo(f"{path.report()}\n\n{compatibility_report(path)}\n\nwritten: {target}\n")


def _refuse(text: str) -> NoReturn:
    """Raise that options do not go together."""
    raise SchemaError("flight reconstruct", [text])


def _path_documents(paths, targets, batch) -> list[dict[str, Any]]:
    """Return the summary of each path for JSON, with the remarks of a batch."""
    documents = []
    for path, target in zip(paths, targets, strict=True):
        document = {"file": str(target), **path.summary()}
        if batch is not None:
            document["remarks"] += remarks_to_json(batch.remarks)
        documents.append(document)
    return documents
