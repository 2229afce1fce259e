"""How far a flown model lies from what flight found, term by term: errors that compensate each
other pass every band.

The evidence is an identified database with its standard errors.  Along the flight states of a case
the contribution of every term of the model (read from the FMU itself) is compared with that of the
evidence, as a share of the standard error of the latter.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from aerodb.comparison.conditions import fill_missing_devices, select_covered_samples
from aerodb.store.schema import HINGE, terms
from aerodb.update.standard_errors import standard_errors
from flightmech import terms as _terms
from flightmech.errors import AeromatchError
from flightmech.names import lookup
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import Simulation
from flightmech.support.arrays import rms
from flightmech.units import DEGREE, FOOT, KNOT, from_si
from pom.cases.case import PomCase
from pom.judging.applicability import reason_not_judged
from pom.tolerances.bands import RowRemark, unwrapped_difference
from pom.tolerances.criteria import Criterion

FAR = 3.0  # standard errors
ROUNDING = 1e-6  # standard errors that are none
SAMPLES = 200  # of a case
LEAST = {
    "CL": 1e-3,
    "CD": 1e-3,
    "CY": 1e-3,
    "CX": 1e-3,
    "CZ": 1e-3,
}  # rms of a contribution that a case uses; moments:
LEAST_MOMENT = 2e-4
BLOCK = "resources/model.bin"


class Evidence:
    """What flight found, along the states of one case.

    Parameters
    ----------
    database : DataTree
        An identified database: terms with ``stderr`` and ``source``.
    states : Dataset (time,)
        Flight states of the case. [SI]
    hinges : bool
        Whether the case feels hinge moments: surfaces that the record drives do not.

    Attributes
    ----------
    samples : dict of str to array (samples,)
        The variables of the terms. [SI]
    found : dict of str to (array, array, array)
        By term: contribution, its standard error, and which samples rest on nodes from flight.
    """

    def __init__(self, database: xr.DataTree, states: xr.Dataset, hinges: bool = True):
        leaves = {name: leaf for name, leaf in terms(database).items() if _from_flight(leaf).any()}
        leaves = {
            name: leaf for name, leaf in leaves.items() if hinges or name.split("/")[0] not in HINGE
        }
        every = max(1, states.sizes["time"] // SAMPLES)
        whole, _ = fill_missing_devices(states.isel(time=slice(None, None, every)), database)
        self.samples, *_ = select_covered_samples(whole, leaves.values()) if leaves else ({}, 0)
        self.found: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        count = len(next(iter(self.samples.values()), ()))
        for name, leaf in leaves.items():
            B = _terms.basis(leaf, self.samples, "clamp")
            value = np.broadcast_to(_terms.evaluate_term(leaf, self.samples, "clamp"), count)
            sigma, weights = standard_errors(B, leaf), abs(B)
            flown = (
                weights @ _from_flight(leaf).ravel() > 0.5 * np.asarray(weights.sum(axis=1)).ravel()
            )
            self.found[name] = value, np.broadcast_to(sigma, count), np.broadcast_to(flown, count)

    def distances(self, model: SimModel) -> dict[str, float]:
        """Return how far the terms of a model that the case uses lie from the evidence, in standard
        errors, the farthest first.

        Root mean square of the differences over that of the standard errors, over the samples whose
        nodes are from flight.  A term is used when the contribution of model or evidence has an rms
        of 1e-3 (forces) or 2e-4 (moments).
        """
        contributions = self._of(model)
        found = {}
        for name, (value, sigma, flown) in self.found.items():
            if not flown.any() or not (sigma[flown] > 0.0).any():
                continue
            own = contributions.get(name, np.zeros_like(value))
            if max(rms(value[flown]), rms(own[flown])) >= LEAST.get(
                name.split("/")[0], LEAST_MOMENT
            ):
                found[name] = rms((own - value)[flown]) / rms(sigma[flown])
        return dict(sorted(found.items(), key=lambda item: -item[1]))

    def _of(self, model: SimModel) -> dict[str, np.ndarray]:
        count = len(next(iter(self.samples.values()), ()))
        columns = np.zeros((count, len(model.variables)))
        for k, name in enumerate(model.variables):
            columns[:, k] = self.samples.get(name, 0.0)
        parts = Simulation(model.model).evaluate(columns)[1]
        return {name: parts[:, k] for k, name in enumerate(model.terms)}


def evidence_remarks(evidence: Evidence, fmu: str | Path) -> tuple[RowRemark, ...]:
    """Return the remarks on a flown FMU: its distance from the evidence, and the terms beyond three
    standard errors by name.

    An FMU of another program, or of another version of this one, gives the reason why it cannot be
    compared.
    """
    try:
        model = flown_model(fmu)
        distances = evidence.distances(model) if model else {}
    except AeromatchError as error:
        return (RowRemark("evidence", f"not compared with the flight evidence: {error}"),)
    if model is None:
        return (
            RowRemark(
                "evidence",
                "not compared with the flight evidence: the FMU holds no tables of this program",
            ),
        )
    return distance_remarks(distances)


def distance_remarks(distances: Mapping[str, float]) -> tuple[RowRemark, ...]:
    """Return the remarks on the distances of `Evidence.distances`: their rms, and the terms beyond
    three standard errors by name.
    """
    if not distances:
        return (
            RowRemark(
                "evidence",
                "not compared with the flight evidence: no term that the case uses was found "
                "from flight",
            ),
        )
    joint = rms([*distances.values()])
    text = (
        f"distance from the flight evidence: {joint if joint > ROUNDING else 0.0:.2g} "
        f"standard errors, rms of {len(distances)} terms"
    )
    remarks = [RowRemark("evidence", text, values={"rms": joint, **distances}, unit="1")]
    far = {name: size for name, size in distances.items() if size > FAR}
    if far:
        listed = ", ".join(f"{name} {size:.1f}" for name, size in far.items())
        remarks.append(
            RowRemark(
                "far_from_evidence",
                f"beyond {FAR:g} standard errors from what flight found: {listed}",
                values=far,
                unit="1",
            )
        )
    return tuple(remarks)


def flown_model(fmu: str | Path) -> SimModel | None:
    """Return the model inside an FMU of this program; None for another's."""
    with zipfile.ZipFile(fmu) as archive:
        return SimModel(archive.read(BLOCK)) if BLOCK in archive.namelist() else None


def _from_flight(leaf: xr.Dataset) -> np.ndarray:
    """Return which nodes of a term are from flight; none where it has no standard errors."""
    if not {"source", "stderr"} <= set(leaf):
        return np.zeros(leaf["value"].shape, bool)
    return leaf["source"].values == _terms.SOURCES.index("flight")


BANDS = {
    "V_cas": 5.0 * KNOT,
    "h": 100.0 * FOOT,
    "theta": 3.0 * DEGREE,
    "phi": 4.0 * DEGREE,
    "psi": 15.0 * DEGREE,
    "alpha": 2.0 * DEGREE,
    "beta": 2.0 * DEGREE,
    "p": 4.0 * DEGREE,
    "q": 3.0 * DEGREE,
    "r": 3.0 * DEGREE,
    "nz": 0.15,
}
"""Half width of every watched channel.  About twice the time-history tolerances of Table A2A; that of the heading is wide since
it integrates the smallest asymmetry.  The rule has no such numbers, these are ours. [SI]"""
SHARE = 0.25  # of the largest departure of the flight from its start, where that is wider
SLOWEST = 15.0  # [m s-1] below it the flow angles mean nothing


def watch_channels(
    case: PomCase,
    time: np.ndarray,
    flight: Mapping[str, np.ndarray],
    model: Mapping[str, np.ndarray],
) -> tuple[RowRemark, ...]:
    """Return a remark of kind ``watch`` for every channel without a tolerance that leaves its band.

    Parameters
    ----------
    case : PomCase
        Settled on the flight; what it judges by a time history is not watched.
    time : array (time,)
        [s]
    flight, model : mapping of str to array (time,)
        Signals by SI name; samples that are not a number are not looked at. [SI]
    """
    if case.reference == "footprint":
        return ()
    judged = {c.channel for c in case.criteria if _judged(case, c)}
    airborne = (
        np.asarray(flight["V_cas"]) > SLOWEST if "V_cas" in flight else np.ones(time.size, bool)
    )
    found = []
    for name, least in BANDS.items():
        if name in judged or name not in flight or name not in model:
            continue
        trace, error = flight[name], np.abs(unwrapped_difference(name, flight[name], model[name]))
        counted = np.isfinite(error) & (airborne if name in ("alpha", "beta") else True)
        if not counted.any():
            continue
        band = max(least, SHARE * float(np.max(np.abs(trace[counted] - trace[counted][0]))))
        worst = int(np.argmax(np.where(counted, error, -1.0)))
        if error[worst] > band:
            found.append(_remark(name, float(error[worst]), band, float(time[worst])))
    return tuple(found)


def _judged(case: PomCase, criterion: Criterion) -> bool:
    return (
        criterion.applies
        and criterion.measure == "trace"
        and not reason_not_judged(case, criterion)
    )


def _remark(name: str, error: float, band: float, at: float) -> RowRemark:
    unit = lookup(name).display_units
    values = {"off": float(from_si(error, unit)), "band": float(from_si(band, unit))}
    shown = "" if unit == "1" else f" {unit}"
    off = f"{lookup(name).long_name} off by {values['off']:.3g}{shown} at {at:.1f} s"
    text = f"{off}, without a tolerance, watched within {values['band']:.3g}{shown}"
    return RowRemark("watch", text, name, values, unit)
