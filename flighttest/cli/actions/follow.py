"""Function that performs the command of `flighttest.cli.follow`."""

from __future__ import annotations

import codecs
import json
import math
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

import click
import numpy as np

from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import ParseError, SchemaError
from flightmech.support.console import collect_options
from flighttest.in_flight.flight_estimate import AccuracyGoal, FlightEstimate
from flighttest.in_flight.following import FlightFollower
from flighttest.in_flight.sample_stream import SampleStream
from flighttest.records.readers.name_map_reading import read_names
from flighttest.regression.equation_error.model import RegressionModel, term_powers, term_text

_PIECE = 65536  # bytes of one reading
_PAUSE = 0.02  # between two looks at a file that grows [s]


@dataclass(frozen=True)
class FollowerOptions:
    """Options of the estimation during the flight, by the names of `flighttest.cli.follow`.

    Attributes
    ----------
    aircraft_file : str or None
        Aircraft whose mass and geometry give the coefficients.
    model_text : str
    candidates : tuple of str
        Further terms, which enter the model if the evidence for them is strong.
    constraints : tuple of str
        Constraints among the parameters.
    band : (float, float)
        Band of the frequencies [Hz].
    spacing : float
        Time between two estimates [s].
    rate : float or None
        Samples per second.
    goals : tuple of (str, str)
        Term, and the standard error or share at which its estimate is accurate.
    """

    aircraft_file: str | None
    model_text: str
    candidates: tuple[str, ...]
    constraints: tuple[str, ...]
    band: tuple[float, float]
    spacing: float
    rate: float | None
    goals: tuple[tuple[str, str], ...]

    def make_follower(self) -> FlightFollower:
        """Return the estimator."""
        return FlightFollower(
            RegressionModel.parse(self.model_text),
            None if self.aircraft_file is None else read_aircraft(self.aircraft_file),
            band=self.band,
            spacing=self.spacing,
            candidates=self.candidates,
            goals=[_parse_goal(term, limit) for term, limit in self.goals],
            rate=self.rate,
            constraints=self.constraints,
        )


@collect_options(options=FollowerOptions)
def run_follow(
    ctx: click.Context,
    stream: str,
    options: FollowerOptions,
    names: str | None,
    wait: float,
    as_json: bool,
) -> None:
    """Perform the command ``follow``."""
    follower = options.make_follower()
    samples = SampleStream(follower.choose_channels, None if names is None else read_names(names))
    last = None
    for estimate in _estimates(follower, samples, stream, wait):
        last = estimate
        click.echo(json.dumps(estimate.as_dict()) if as_json else estimate.line())
        sys.stdout.flush()
        if estimate.is_accurate:
            break
    if samples.has_rest and not (last is not None and last.is_accurate):
        click.echo("the last line has no end, it is left out", err=True)
    if not samples.channels:
        raise ParseError(stream, 1, "no heading", "CSV with one heading line")
    if not samples.read and samples.left_out:
        raise ParseError(
            stream,
            2,
            f"no sample in {samples.left_out} lines",
            "numbers with decimal points, one for each heading",
        )
    is_useful = last is not None and not last.waiting
    is_reached = last is not None and (last.is_accurate or not options.goals)
    ctx.exit(0 if is_useful and is_reached else 1)


def _parse_goal(term: str, limit: str) -> AccuracyGoal:
    """Return the goal of a term: a standard error such as ``0.4``, or a share such as ``5%``."""
    is_share = limit.strip().endswith("%")
    try:
        value = float(limit.strip().removesuffix("%"))
    except ValueError:
        value = 0.0
    if not 0.0 < value < math.inf:
        raise SchemaError(
            "flight follow",
            [f"--until {term} {limit!r}; a positive standard error or share, as 0.4 or 5%"],
        )
    return AccuracyGoal(
        term_text(term_powers(term)), value / 100.0 if is_share else value, is_share
    )


def _estimates(
    follower: FlightFollower, samples: SampleStream, stream: str, wait: float
) -> Iterator[FlightEstimate]:
    """Yield the estimates of a stream up to its end, or to an interruption."""
    decoder = codecs.getincrementaldecoder("utf-8")("replace")
    try:
        if stream == "-":
            pieces = _pieces_of_input(sys.stdin.buffer)
        else:
            pieces = _pieces_of_file(stream, wait)
        for piece in pieces:
            time_of, values = samples.feed(decoder.decode(piece))
            yield from follower.add(time_of, values, samples.left_out)
    except KeyboardInterrupt:
        pass
    nothing = np.zeros((0, len(samples.channels)))
    yield from follower.add(np.zeros(0), nothing, samples.left_out, final=True)


def _pieces_of_input(source: BinaryIO) -> Iterator[bytes]:
    """Yield what arrives on an input, without waiting for a full piece."""
    read = getattr(source, "read1", source.read)
    while piece := read(_PIECE):
        yield piece


def _pieces_of_file(path: str, wait: float) -> Iterator[bytes]:
    """Yield the content of a file, and what is appended until nothing comes for `wait` seconds."""
    with open(path, "rb") as source:
        since, count = time.monotonic(), 0
        while True:
            piece = source.read(_PIECE)
            if piece:
                count += len(piece)
                yield piece
                since = time.monotonic()
                continue
            if os.fstat(source.fileno()).st_size < count:
                raise ParseError(path, 0, "a file that was cut while it was read", "one that grows")
            if time.monotonic() - since >= wait:
                return
            time.sleep(_PAUSE)
