"""Distance of a model from the flight estimates of its terms, and watched channels.

Errors that compensate each other can pass every band.  The evidence is an identified database with
its standard errors.  Along the flight states of a case, the contribution of every term of the model
(read from the FMU itself) is compared with the contribution of the evidence, in standard errors of
the latter.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import scipy
import xarray as xr

from aerodb.comparison.conditions import select_covered_samples
from aerodb.comparison.record_conditions import fill_missing_devices
from aerodb.store.identified_terms import is_changed
from aerodb.store.schema import HINGE, terms
from aerodb.update.standard_errors import standard_errors
from flightmech import terms as _terms
from flightmech.errors import AeromatchError
from flightmech.flown_samples import FLOWN_SAMPLES
from flightmech.names import lookup, value_text
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import Simulation
from flightmech.support.arrays import rms
from flightmech.units import DEGREE, FOOT, KNOT, from_si
from pom.cases.case import PomCase
from pom.judging.applicability import reason_not_judged
from pom.tolerances.bands import RowRemark, unwrapped_difference
from pom.tolerances.criteria import Criterion

FAR = 3.0  # standard errors
ROUNDING = 1e-6  # standard errors: a smaller distance is printed as zero
SAMPLES = 200  # largest number of samples of a case, roughly
# rms of a contribution that a case uses: forces by coefficient, and all moments.
LEAST = dict.fromkeys(("CL", "CD", "CY", "CX", "CZ"), 1e-3)
LEAST_MOMENT = 2e-4
BLOCK = "resources/model.bin"
EDITS = ("scale:", "shift:", "set_nodes:", "pom tune")
"""Starts of the lines of a term's history that state an edit by hand or by a tuning."""
IDENTIFIED = "identified from flight"
JOINED = ("tabulate:", "regress_tables:", "join_submodels:")
"""Starts of the lines of a term's history that state fits of flights."""


class Evidence:
    """Flight estimates of terms, along the states of one case.

    Parameters
    ----------
    database : DataTree
        An identified database: terms with ``stderr`` and ``source``.
    states : Dataset (time,)
        Flight states of the case. [SI]
    hinges : bool
        Whether hinge moments affect the case.  They do not if the record drives the surfaces.

    Attributes
    ----------
    samples : dict of str to array (samples,)
        The variables of the terms. [SI]
    estimates : dict of str to (array, array, array)
        By term: contribution, its standard error, and the mask of samples whose nodes are from
        flight, each (samples,).
    edited : tuple of str
        Terms that the case uses and that the database has from a judgement or an edit: they are no
        evidence, and a model with the same numbers shows no distance from them.
    unstamped : bool
        The database is from before terms had a stamp (`aerodb.store.identified_terms`): edits that
        its history does not state are not found.
    """

    def __init__(self, database: xr.DataTree, states: xr.Dataset, hinges: bool = True):
        leaves = {}
        self._names, self._hinges = set(terms(database)), hinges
        is_stamped = FLOWN_SAMPLES in database.attrs
        for name, leaf in terms(database).items():
            is_hinge = name.split("/")[0] in HINGE
            has_evidence = nodes_from_flight(leaf).any() or _is_edited(name, leaf, is_stamped)
            if has_evidence and (hinges or not is_hinge):
                leaves[name] = leaf
        # every n-th state, so that at least SAMPLES remain of a longer record
        step = max(1, states.sizes["time"] // SAMPLES)
        thinned, _ = fill_missing_devices(states.isel(time=slice(None, None, step)), database)
        self.samples: dict[str, np.ndarray] = {}
        if leaves:
            self.samples, *_ = select_covered_samples(thinned, leaves.values())
        self.estimates: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        edited = []
        for name, leaf in leaves.items():
            if nodes_from_flight(leaf).any():
                self.estimates[name] = self._estimate(leaf)
            value = np.asarray(_terms.evaluate_term(leaf, self.samples, "clamp"))
            is_used = rms(value) >= _least(name)
            if is_used and _is_edited(name, leaf, is_stamped):
                edited.append(name)
        self.edited = tuple(edited)
        self.unstamped = not is_stamped and any(_was_joined(leaf) for leaf in leaves.values())

    def _estimate(self, leaf: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return contribution, standard error and flight mask of a term (samples,)."""
        # B has the weights of the nodes at each sample (samples, nodes).
        count = self._count()
        B = _terms.basis(leaf, self.samples, "clamp")
        value = np.broadcast_to(_terms.evaluate_term(leaf, self.samples, "clamp"), count)
        sigma, weights = standard_errors(B, leaf), abs(B)
        # A sample is from flight if more than half the weight of its nodes is.
        flight_weight = weights @ nodes_from_flight(leaf).ravel()
        is_flight = flight_weight > 0.5 * np.asarray(weights.sum(axis=1)).ravel()
        return value, np.broadcast_to(sigma, count), np.broadcast_to(is_flight, count)

    def _count(self) -> int:
        return len(next(iter(self.samples.values()), ()))

    def distances(self, model: SimModel) -> dict[str, float]:
        """Return the distances of the used terms of a model from the evidence, largest first.

        A distance is the rms of the differences over the rms of the standard errors, over the
        samples whose nodes are from flight.  A case uses a term if the contribution of model or
        evidence has an rms of at least 1e-3 (forces) or 2e-4 (moments). [standard errors]
        """
        contributions = self._evaluate_terms(model)
        distances = {}
        for name, (value, sigma, is_flight) in self.estimates.items():
            # without a standard error there is no unit of distance
            if not is_flight.any() or not (sigma[is_flight] > 0.0).any():
                continue
            # a model without the term has no contribution
            contribution = contributions.get(name, np.zeros_like(value))
            size = max(rms(value[is_flight]), rms(contribution[is_flight]))
            if size >= _least(name):
                difference = rms((contribution - value)[is_flight])
                distances[name] = difference / rms(sigma[is_flight])
        return dict(sorted(distances.items(), key=lambda item: -item[1]))

    def lacking(self, model: SimModel) -> list[str]:
        """Return the terms that the case and the model use and the database does not have."""
        absent = set(model.terms) - self._names
        if not self._hinges:
            absent = {name for name in absent if name.split("/")[0] not in HINGE}
        if not absent or not self.samples:
            return []
        parts = self._evaluate_terms(model)
        return [name for name in model.terms if name in absent and rms(parts[name]) >= _least(name)]

    def _evaluate_terms(self, model: SimModel) -> dict[str, np.ndarray]:
        """Return the contribution of every term of a model (samples,)."""
        columns = np.zeros((self._count(), len(model.variables)))
        for k, name in enumerate(model.variables):
            columns[:, k] = self.samples.get(name, 0.0)
        parts = Simulation(model.model).evaluate(columns)[1]
        return {name: parts[:, k] for k, name in enumerate(model.terms)}


def _least(name: str) -> float:
    return LEAST.get(name.split("/")[0], LEAST_MOMENT)


def evidence_remarks(evidence: Evidence, fmu: str | Path) -> tuple[RowRemark, ...]:
    """Return the remarks on an FMU: its distance from the evidence, and its far terms by name.

    A term is far beyond three standard errors.  For an FMU of another program, or of another
    version of this one, the remark is the reason why it cannot be compared.
    """
    try:
        model = flown_model(fmu)
        if model is None:
            return _no_evidence("the FMU holds no tables of this program")
        return (
            *distance_remarks(evidence.distances(model)),
            *_edited_remarks(evidence.edited),
            *_lacking_remarks(evidence.lacking(model)),
            *_unstamped_remarks(evidence.unstamped),
        )
    except AeromatchError as error:
        return _no_evidence(str(error))


def _edited_remarks(edited: tuple[str, ...]) -> tuple[RowRemark, ...]:
    """Return the remark on terms of the evidence that are edited; empty without one."""
    if not edited:
        return ()
    text = (
        f"no evidence for {', '.join(edited)}: edited after the identification; give the database "
        f"as identified, or a pass does not exclude compensating errors"
    )
    return (RowRemark("edited_evidence", text),)


def _lacking_remarks(lacking: Sequence[str]) -> tuple[RowRemark, ...]:
    """Return the remark on terms that the evidence does not have; empty without one."""
    if not lacking:
        return ()
    text = (
        f"no evidence for {', '.join(lacking)}: the model has a term that the evidence is without; "
        f"a pass does not exclude compensating errors"
    )
    return (RowRemark("no_evidence", text),)


def _unstamped_remarks(unstamped: bool) -> tuple[RowRemark, ...]:
    """Return the remark on evidence whose edits cannot be found; empty if they can."""
    if not unstamped:
        return ()
    text = (
        "the evidence is from before terms had a stamp of their identification: edits by hand are "
        "not found; identify it again"
    )
    return (RowRemark("edited_evidence", text),)


def _no_evidence(reason: str) -> tuple[RowRemark, ...]:
    """Return the notice on a model that has no terms to compare."""
    text = (
        f"not compared with the flight evidence: {reason}; a pass does not exclude compensating "
        f"errors"
    )
    return (RowRemark("no_evidence", text),)


def distance_remarks(distances: Mapping[str, float]) -> tuple[RowRemark, ...]:
    """Return the remarks on the distances of `Evidence.distances`.

    They state the rms of the distances, and by name the terms beyond three standard errors.
    """
    if not distances:
        text = (
            "not compared with the flight evidence: no term that the case uses was found from "
            "flight"
        )
        return (RowRemark("evidence", text),)
    joint = rms([*distances.values()])
    printed = joint if joint > ROUNDING else 0.0
    text = (
        f"distance from the flight evidence: {printed:.2g} standard errors, rms of "
        f"{len(distances)} terms"
    )
    remarks = [RowRemark("evidence", text, values={"rms": joint, **distances}, unit="1")]
    far = {name: size for name, size in distances.items() if size > FAR}
    if far:
        listed = ", ".join(f"{name} {size:.1f}" for name, size in far.items())
        text = f"beyond {FAR:g} standard errors from what flight found: {listed}"
        remarks.append(RowRemark("far_from_evidence", text, values=far, unit="1"))
    return tuple(remarks)


def flown_model(fmu: str | Path) -> SimModel | None:
    """Return the model inside an FMU of this program; None for an FMU of another program."""
    with zipfile.ZipFile(fmu) as archive:
        if BLOCK not in archive.namelist():
            return None
        return SimModel(archive.read(BLOCK))


@lru_cache(maxsize=16)
def kept_model(fmu: Path, sha256: str) -> SimModel | None:
    """Return `flown_model` of a file with this content; the cases of a batch share it.

    `sha256` is a key.  Names and entries of a model are read from its block once.
    """
    return flown_model(fmu)


def nodes_from_flight(leaf: xr.Dataset) -> np.ndarray:
    """Return the mask of the nodes from flight; false for a term without standard errors."""
    if not {"source", "stderr"} <= set(leaf):
        return np.zeros(leaf["value"].shape, bool)
    return leaf["source"].values == _terms.SOURCES.index("flight")


def _is_edited(name: str, leaf: xr.Dataset, is_stamped: bool) -> bool:
    """Return whether a term was scaled, shifted, set, tuned or changed after its identification.

    `is_stamped`: the identifications of the database are of a version that stamps terms.
    """
    changed = is_changed(leaf)
    if changed is not None:
        return changed
    # The stamp was removed.  Hinge moments and ground effect are identified without one.
    coefficient, _, contribution = name.partition("/")
    has_none = coefficient in HINGE or contribution.startswith("ground")
    if is_stamped and not has_none and nodes_from_flight(leaf).any():
        return True
    # The history shows an edit even if its source is stated as flight.
    lines = str(leaf.attrs.get("history", "")).splitlines()
    found = []
    for number, line in enumerate(lines):
        # the note of an edit may say anything
        if IDENTIFIED in line and not line.startswith(EDITS):
            found.append(number)
    # a term that was never identified claims no evidence
    if not found:
        return False
    later = lines[found[-1] + 1 :]
    return any(line.startswith(EDITS) for line in later)


def _was_joined(leaf: xr.Dataset) -> bool:
    """Return whether the table of a term is from fits of flights, by its history or its sources."""
    lines = str(leaf.attrs.get("history", "")).splitlines()
    return any(line.startswith(JOINED) for line in lines) and bool(nodes_from_flight(leaf).any())


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
"""Half width of every watched channel. [SI]

They are about twice the time-history tolerances of Table A2A.  The band of the heading is wide,
since the heading integrates the smallest asymmetry.  The table has no such numbers; the values are
our choice.
"""
SHARE = 0.25  # of the largest departure of the flight from its start, if that is wider
SLOWEST = 15.0  # [m s-1] at a smaller airspeed the flow angles are not meaningful


def watch_channels(
    case: PomCase,
    time: np.ndarray,
    flight: Mapping[str, np.ndarray],
    model: Mapping[str, np.ndarray],
) -> tuple[RowRemark, ...]:
    """Return a ``watch`` remark for every channel without a tolerance that leaves its band.

    Parameters
    ----------
    case : PomCase
        Case after `settle_case`.  Channels with a judged time history are not watched.
    time : array (time,)
        [s]
    flight, model : mapping of str to array (time,)
        Signals by canonical name; samples that are not finite are ignored. [SI]
    """
    if case.reference == "footprint":
        return ()
    judged = {item.channel for item in case.criteria if _is_judged_trace(case, item)}
    airborne = np.ones(time.size, bool)
    if "V_cas" in flight:
        airborne = np.asarray(flight["V_cas"]) > SLOWEST
    remarks = []
    for name, least in BANDS.items():
        if name in judged or name not in flight or name not in model:
            continue
        trace, error = flight[name], np.abs(unwrapped_difference(name, flight[name], model[name]))
        # at low speed the flow angles have no meaning
        counted = np.isfinite(error)
        if name in ("alpha", "beta"):
            counted = counted & airborne
        if not counted.any():
            continue
        # a flight far from its start has a wider band
        band = max(least, SHARE * float(np.max(np.abs(trace[counted] - trace[counted][0]))))
        worst = int(np.argmax(np.where(counted, error, -1.0)))
        if error[worst] > band:
            remark = _watch_remark(name, float(error[worst]), band=band, time=float(time[worst]))
            is_gross = counted & (error > GROSS * band)
            if float(np.sum(np.gradient(time)[is_gross])) >= GROSS_TIME:
                remark = replace(remark, kind="departure", text=f"departure: {remark.text}")
            remarks.append(remark)
    return tuple(remarks)


GROUND_VELOCITY = ("vn", "ve")
GROSS = 3.0  # times its band: a watched channel so far off is a departure; our choice
GROSS_TIME = 0.5  # [s] for so long in all; the peak of a touchdown is shorter
TRACK = 10.0 * FOOT
"""Half width of the position across the flown track on the ground: the lateral deviation of the
automatic landing, 2.e.5. [m]"""
_MOVING = 1.0  # [m s-1] a slower motion over the ground has no direction


def watch_track(
    case: PomCase,
    time: np.ndarray,
    flight: Mapping[str, np.ndarray],
    model: Mapping[str, np.ndarray],
) -> tuple[RowRemark, ...]:
    """Return the remark on a model that leaves the flown track on the ground.

    The position is the integral of the velocity over the ground.  Across is square to the flown
    direction of that instant.  Beyond `GROSS` bands the remark is a departure.

    Parameters
    ----------
    case : PomCase
        A case that starts on its wheels (``drive.trim = "ground"``) or lands.
    time : array (time,)
        [s]
    flight, model : mapping of str to array (time,)
        Signals by canonical name, with ``vn`` and ``ve``. [SI]
    """
    on_ground = case.drive.trim == "ground"
    has_velocity = all(name in flight and name in model for name in GROUND_VELOCITY)
    if case.reference == "footprint" or not on_ground or not has_velocity:
        return ()
    # the row of the lateral deviation is stricter
    if any(item.channel == "y_runway" and _is_judged_trace(case, item) for item in case.criteria):
        return ()
    velocity = np.stack([flight["vn"], flight["ve"]])
    offset = scipy.integrate.cumulative_trapezoid(
        np.stack([model["vn"], model["ve"]]) - velocity, time, initial=0.0
    )
    moving = np.hypot(*velocity) > _MOVING
    if not np.isfinite(offset).all() or not moving.any():
        return ()
    # before the first and after the last motion the nearest direction counts
    course = np.unwrap(np.arctan2(velocity[1], velocity[0])[moving])
    course = np.interp(time, time[moving], course)
    across = offset[1] * np.cos(course) - offset[0] * np.sin(course)
    worst = int(np.argmax(np.abs(across)))
    error = float(abs(across[worst]))
    if error <= TRACK:
        return ()
    side = "right" if across[worst] > 0.0 else "left"
    text = (
        f"the model is {error / FOOT:.0f} ft to the {side} of the flown track over the ground at "
        f"{time[worst]:.1f} s, without a tolerance, watched within {TRACK / FOOT:.0f} ft"
    )
    values = {"off": error, "band": TRACK}
    if error > GROSS * TRACK:
        return (RowRemark("departure", f"departure: {text}", "y_runway", values, "m"),)
    return (RowRemark("watch", text, "y_runway", values, "m"),)


def _is_judged_trace(case: PomCase, criterion: Criterion) -> bool:
    if not criterion.applies or criterion.measure != "trace":
        return False
    return not reason_not_judged(case, criterion)


def _watch_remark(name: str, error: float, *, band: float, time: float) -> RowRemark:
    unit = lookup(name).display_units
    values = {"off": float(from_si(error, unit)), "band": float(from_si(band, unit))}
    off = f"{lookup(name).long_name} off by {value_text(name, error, '.3g')} at {time:.1f} s"
    text = f"{off}, without a tolerance, watched within {value_text(name, band, '.3g')}"
    return RowRemark("watch", text, name, values=values, unit=unit)
