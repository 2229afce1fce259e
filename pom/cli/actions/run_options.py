"""Options of the command ``run``, as one object."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click


@dataclass(frozen=True)
class RunOptions:
    """Options of the command ``run`` by the names of `pom.cli.group`.

    Attributes
    ----------
    cases : tuple of Path
        Case files, or folders of them.
    models, tables, databases, tunings : tuple of str
        ``NAME=FILE`` of ``--model``, ``--names``, ``--database`` and ``--tuning``.
    starts, masters, recurrent_share
        Recordings of devices, and the earlier reports of recurrent tests.
    output, title, revision, date, paper, units, no_pdf, signed
        The report.
    junit : str or None
    timeout, jobs, scheduler, resume
        The flights.
    biases_file, tolerances_file, evidence
        Further files.
    samples, seed : int
        Draws of the models.
    verbose, as_json : bool
        What is printed.
    """

    cases: tuple[Path, ...]
    models: tuple[str, ...]
    starts: tuple[str, ...]
    masters: tuple[str, ...]
    recurrent_share: float | None
    output: Path | None
    title: str
    revision: str
    date: str
    paper: str
    units: str | None
    no_pdf: bool
    signed: tuple[tuple[str, str, str], ...]
    junit: str | None
    tables: tuple[str, ...]
    timeout: float
    jobs: int
    scheduler: str | None
    resume: Path | None
    biases_file: str | None
    tolerances_file: str | None
    evidence: str | None
    samples: int
    seed: int
    databases: tuple[str, ...]
    tunings: tuple[str, ...]
    verbose: bool
    as_json: bool

    def demand_pairs(self) -> None:
        """Raise if an option is without the option that it requires."""
        if bool(self.samples) != bool(self.databases):
            raise click.UsageError(
                "--samples and --database go together: the number of draws, and the database of "
                "each model to draw from"
            )
        if self.tunings and self.output is None:
            raise click.UsageError("--tuning needs -o: the log is a chapter of the report")
        if self.recurrent_share is not None and not self.masters:
            raise click.UsageError("--recurrent-share needs --master: the report to compare with")
