"""The quality of a flight record: every check in order, each with the mistakes undone that the ones before it found."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.console import plain
from flightmech.whole import written_whole

from ..instruments import Instruments, instruments
from ..record import manoeuvres
from .answers import answer_findings, answers, hands
from .excitation import correlations, excitation, excitation_findings
from .finding import SEVERITIES, Finding, by_severity, without_consequences
from .kinematics import accuracy_findings, kinematic_findings, kinematic_table
from .lags import lag_findings, lags
from .relations import Comparison, compare_all
from .remarks import remarks
from .repairs import explain
from .samples import channel_findings, channel_table, faults_of, mark_findings
from .signals import Signals, at_cg, signals_of

if TYPE_CHECKING:
    from flightmech.aircraft import Aircraft


@dataclass(frozen=True)
class Quality:
    """What `assess` found.

    Attributes
    ----------
    facts : dict
        Title, source file, start, purpose, duration [s], share in flight, aircraft.
    findings : list of Finding
        Errors first.
    channels, kinematics, delays, answers, hands, excitation, correlation : DataFrame
        The figures behind them, SI, see the functions that make them.
    comparisons : dict of Comparison
        Both sides of every relation, mistakes undone.
    as_read : dict of Comparison
        The same before any mistake is undone.
    signals : Signals
        As recorded, on the slow clock of the checks.
    """

    facts: dict[str, Any]
    findings: list[Finding]
    channels: pd.DataFrame
    kinematics: pd.DataFrame
    delays: pd.DataFrame
    answers: pd.DataFrame
    hands: pd.DataFrame
    excitation: pd.DataFrame
    correlation: pd.DataFrame
    comparisons: dict[str, Comparison]
    as_read: dict[str, Comparison]
    signals: Signals

    def count(self, severity: str) -> int:
        """Return the number of findings of one severity."""
        return sum(finding.severity == severity for finding in self.findings)

    @property
    def usable(self) -> bool:
        """Whether nothing was found that makes numbers wrong."""
        return self.count("error") == 0

    @property
    def verdict(self) -> str:
        """The whole in one line."""
        counts = ", ".join(f"{self.count(s)} {s}{'s' if self.count(s) != 1 else ''}" for s in SEVERITIES)
        head = "not fit for identification as read" if not self.usable else "fit for use, with care" if self.count("warning") else "sound"
        return f"{head}: {counts}"

    def report(self) -> str:
        """Return the findings and figures as text."""
        from .words import report

        return report(self)

    def as_dict(self) -> dict[str, Any]:
        """Return everything but the time histories, made of types that JSON knows."""
        tables = ("channels", "kinematics", "delays", "answers", "hands", "excitation", "correlation")
        found = {name: getattr(self, name).to_dict("records") for name in tables if name != "correlation"}
        found["correlation"] = self.correlation.to_dict()
        return plain({"facts": self.facts, "verdict": self.verdict, "findings": [f.as_dict() for f in self.findings], **found})

    def to_json(self) -> str:
        """Return `as_dict` as text."""
        return json.dumps(self.as_dict(), indent=2, ensure_ascii=False)

    def write_page(self, path: str | Path) -> None:
        """Write one self-contained HTML page, whole or not at all."""
        from .page import page

        with written_whole(path) as part:
            part.write_text(page(self), encoding="utf-8")


def assess(record: xr.DataTree, aircraft: Aircraft | None = None) -> Quality:
    """Return what is right and wrong with a flight record.

    Parameters
    ----------
    record : DataTree
        As `flighttest.read` returns it.
    aircraft : Aircraft, optional
        With its instruments: places, noise and latency to judge by.  Without it accelerometers and vanes are taken to sit at the c.g.
        and habit judges delays.

    Returns
    -------
    Quality

    Raises
    ------
    SchemaError
        The record holds no channel of motion, or the instruments of the aircraft are not complete.

    Notes
    -----
    In order: clocks and samples of each channel; kinematics and air data, with the search for the mistake that explains what does not
    agree; then, with such mistakes undone, scale errors, delays, the answers to the controls, and excitation.

    References
    ----------
    .. [DataAcquisition] Design, manufacturing, and testing of a data acquisition system for fixed-wing UAS, section IV.B.
    """
    specification = instruments(aircraft.instruments) if aircraft is not None and aircraft.instruments else None
    faults = faults_of(record)
    signals = signals_of(record, faults)
    table = channel_table(record)
    findings = mark_findings(faults) + channel_findings(record, table, specification)
    explanations, mended, comparisons = explain(signals)
    findings += kinematic_findings(explanations, comparisons, mended, record)
    places = _places(specification, aircraft)
    moved = at_cg(mended, places)
    kinematics = kinematic_table(moved)
    delays = lags(moved, places)
    answered, followed = answers(moved), hands(mended)
    excited, matrix = excitation(mended), correlations(mended)
    purpose = str(record.attrs.get("purpose", ""))
    findings += accuracy_findings(kinematics)
    findings += lag_findings(delays, specification)
    findings += answer_findings(answered, followed, moved, record)
    findings += excitation_findings(excited, matrix, mended, manoeuvres(record), purpose)
    findings += remarks(mended, table, comparisons)
    as_read = compare_all(signals) if explanations else comparisons
    findings = by_severity(without_consequences(findings))
    facts = _facts(record, signals, aircraft)
    return Quality(facts, findings, table, kinematics, delays, answered, followed, excited, matrix, comparisons, as_read, signals)


def _places(specification: Instruments | None, aircraft: Aircraft | None) -> dict[str, np.ndarray]:
    """Return the places of accelerometers and vanes from the c.g. [m]"""
    if specification is None or aircraft is None:
        return {}
    cg = np.asarray(aircraft.cg, float)
    given = {name: specification.of(name).position for name in ("ax_imu", "alpha_vane", "beta_vane")}
    return {name: np.asarray(position, float) - cg for name, position in given.items() if position is not None}


def _facts(record: xr.DataTree, signals: Signals, aircraft: Aircraft | None) -> dict[str, Any]:
    facts = {key: str(record.attrs.get(key, "")) for key in ("title", "source_file", "start", "purpose")}
    return {
        **facts,
        "aircraft": aircraft.name if aircraft is not None else "",
        "begin": float(signals.time[0]),
        "end": float(signals.time[-1]),
        "in_flight": float(signals.flying.mean()),
        "columns_left_out": len(str(record.attrs.get("unmapped", "")).split()),
    }
