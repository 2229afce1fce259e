"""Distance of a model from the flight estimates of its terms.

Errors that compensate each other can pass every band.  The evidence is an identified database with
its standard errors.  Along the flight states of a case, the contribution of every term of the model
(read from the FMU itself) is compared with the contribution of the evidence, in standard errors of
the latter.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
import xarray as xr

from aerodb.comparison.conditions import select_covered_samples
from aerodb.comparison.record_conditions import fill_missing_devices
from aerodb.store.identified_terms import is_changed
from aerodb.store.schema import HINGE, terms
from aerodb.update.standard_errors import standard_errors
from flightmech import terms as _terms
from flightmech.errors import AeromatchError
from flightmech.flown_samples import FLOWN_SAMPLES
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import Simulation
from flightmech.support.arrays import rms
from pom.tolerances.bands import RowRemark

FAR = 3.0  # standard errors
ROUNDING = 1e-6  # standard errors: a smaller distance is printed as zero
SAMPLES = 200  # largest number of samples of a case, roughly
# rms of a contribution that a case uses: forces by coefficient, and all moments.
LEAST = dict.fromkeys(("CL", "CD", "CY", "CX", "CZ"), 1e-3)
LEAST_MOMENT = 2e-4
_ENGINE = re.compile(r"engine\d+/")
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
    texts = []
    # the evidence is a database, which never holds the tables of engines
    engines = sorted({name.split("/")[0] for name in lacking if _ENGINE.match(name)})
    if absent := [name for name in lacking if not _ENGINE.match(name)]:
        texts.append(
            f"no evidence for {', '.join(absent)}: the model has a term that the evidence is "
            f"without; a pass does not exclude compensating errors"
        )
    if engines:
        texts.append(
            f"no evidence for the tables of {', '.join(engines)}: the evidence holds the "
            f"aerodynamics alone; compare the engine with what flight engine identified"
        )
    return tuple(RowRemark("no_evidence", text) for text in texts)


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
