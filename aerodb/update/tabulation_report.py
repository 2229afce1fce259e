"""Results of an update with flights: new terms, reports on them, and warnings."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from aerodb.store.identified_terms import stamp_identified
from aerodb.update.cautions.control_sizes import doubtful_sizes
from aerodb.update.cautions.notices import incompatible_fits, suspect_fits
from aerodb.update.correlation import PARTS
from aerodb.update.observations import Observation, samples_outside
from aerodb.update.term_decisions import CORRECTED, REPLACED
from aerodb.update.weights.weight_learning import SUSPECT
from flightmech import terms as _terms
from flightmech.errors import AeromatchWarning
from flightmech.flown_samples import (
    CHANNELS,
    FlownWindow,
    cut_windows,
    pack_windows,
)
from flightmech.flown_states import gather_states, pack_states

_FLIGHT = _terms.SOURCES.index("flight")
# Information of a fit on a node, over that of the most informative fit, from which it contributes.
_LEAST_SHARE = 1e-3
_COLLINEAR = (
    "Pitch rate and rate of incidence move alike in flight; between their terms the "
    "a-priori errors decide."
)


@dataclass(frozen=True)
class Tabulation(Mapping[str, Any]):
    """The new terms ``{"CL/basic": leaf, ...}``, ready for `replace_terms`, and reports on them.

    Attributes
    ----------
    terms : dict of str to Dataset
        Every term that the fits inform.  ``source`` is flight at nodes of the flown region whose
        standard error fell below 0.9 of the a-priori one.  It is unchanged elsewhere.  A node is in
        the flown region if some sample inside the table gives it a quarter of its weight.
    report : DataFrame
        Index term; ``nodes``, ``flight`` (nodes from flight), ``corrected`` and ``identified``
        (nodes with a ratio of posterior to prior standard error below 0.9 and 0.5),
        ``ratio_least``, ``ratio_median``, ``change_rms``, ``change_largest``, ``change_in_sd``
        (largest change, in a-priori standard errors), ``prior_inflation`` (factor on the a-priori
        standard errors; above 1 they were too small), ``level reach long medium short`` (weights
        of the parts of the prior covariance), ``decision`` and ``reason``
        (`aerodb.update.term_decisions`; also attributes of the term).
    points : DataFrame
        Index (coefficient, fit); ``rms_prior`` and ``rms`` (rms of measured minus tables, with the
        prior and with the new tables), ``range`` of the coefficient, ``distance`` of the fit from
        the tables in its own standard errors, ``weight``, ``suspect``, ``clamped`` (share of
        samples outside a table).
    compatibility : DataFrame
        Index coefficient; ``chi2`` of the fits against prior and measurement errors, ``count`` of
        estimates, ``probability``, ``inflation`` (factor on the standard errors of all fits, 1 or
        more, from their disagreement).
    unplaced : DataFrame
        Terms of the fits that no table of the database carries, insignificant ones included.  Index
        (coefficient, fit); ``term``, ``estimate``, ``stderr``, ``t``, ``carried``, ``significant``,
        ``reason``.
    controls : DataFrame
        Effect of each control in flight over its a-priori effect (`control_sizes`).
    notices : tuple of str
        Warnings, one line each; `aerodb.replace_terms` writes them into the history of the
        database.
    flown_samples, flown_states : str
        The samples of the fits and their states in short form (`flightmech.flown_samples`,
        `flightmech.flown_states`), which `aerodb.replace_terms` writes into the database.
    """

    terms: dict[str, xr.Dataset]
    report: pd.DataFrame
    points: pd.DataFrame
    compatibility: pd.DataFrame
    unplaced: pd.DataFrame = field(default_factory=pd.DataFrame)
    controls: pd.DataFrame = field(default_factory=pd.DataFrame)
    notices: tuple[str, ...] = ()
    flown_samples: str = ""
    flown_states: str = ""

    def __getitem__(self, name: str) -> xr.Dataset:
        return self.terms[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.terms)

    def __len__(self) -> int:
        return len(self.terms)


def make_empty_tabulation(notice: str) -> Tabulation:
    """Return the tabulation of a database that no flight changes, and the reason as its notice."""
    no_fits = pd.MultiIndex.from_arrays([[], []], names=["coefficient", "fit"])
    return Tabulation(
        {},
        report=pd.DataFrame(
            columns=["nodes", "flight", "corrected", "identified", "decision", "reason"],
            index=pd.Index([], name="term"),
        ),
        points=pd.DataFrame(columns=["weight", "suspect"], index=no_fits),
        compatibility=pd.DataFrame(
            columns=["chi2", "count", "probability", "inflation"],
            index=pd.Index([], name="coefficient"),
        ),
        notices=(notice,),
    )


def merge_tabulations(tabulations: Sequence[Tabulation]) -> Tabulation:
    """Return the tabulations of several coefficients as a single one."""
    new: dict[str, xr.Dataset] = {}
    for tabulation in tabulations:
        new.update(tabulation.terms)
    return Tabulation(
        new,
        report=pd.concat([tabulation.report for tabulation in tabulations]),
        points=pd.concat([tabulation.points for tabulation in tabulations]),
        compatibility=pd.concat([tabulation.compatibility for tabulation in tabulations]),
    )


def add_cautions(
    tabulation: Tabulation,
    unplaced: pd.DataFrame,
    notices: Sequence[str],
    samples: Iterable[tuple[str, xr.Dataset]],
    controls: pd.DataFrame,
) -> Tabulation:
    """Return a tabulation with its terms without a place, all notices and the flown samples.

    It warns of each notice.  `samples` are name and data (sample,) of each fit, `controls` the
    sizes of the controls.
    """
    without_place = [
        f"no place in the database, the estimate is left out: {line}" for line in notices
    ]
    texts = (
        *without_place,
        *incompatible_fits(tabulation.compatibility, tabulation.report),
        *suspect_fits(tabulation.points),
        *doubtful_sizes(controls).values(),
    )
    for text in texts:
        # The warning belongs to the line that calls the public function, two frames up.
        warnings.warn(text, AeromatchWarning, stacklevel=3)
    samples = list(samples)
    return replace(
        tabulation,
        terms={name: stamp_identified(leaf) for name, leaf in tabulation.terms.items()},
        unplaced=unplaced,
        controls=controls,
        notices=texts,
        flown_samples=pack_flown_samples(samples),
        flown_states=pack_states(gather_states(data for _, data in samples)),
    )


def pack_flown_samples(samples: Iterable[tuple[str, xr.Dataset]]) -> str:
    """Return the samples of fits in short form (`flightmech.flown_samples`).

    Published fits have no samples.
    """
    windows: list[FlownWindow] = []
    for name, data in samples:
        if "time" in data:
            channels = {key: data[key].values for key in CHANNELS if key in data}
            windows += cut_windows(name, data["time"].values.astype(float), channels)
    return pack_windows(windows)


def new_leaf(
    leaf: xr.Dataset,
    value: np.ndarray,
    sd: np.ndarray,
    flown: np.ndarray,
    contributors: Sequence[str],
    history: str,
) -> xr.Dataset:
    """Return a term with new nodes, their sources, a comment and a line of history.

    Parameters
    ----------
    leaf : Dataset
        The term a priori.
    value, sd : array (nodes,)
        New values and standard errors, in the order of ``value.ravel()``.
    flown : array of bool (nodes,)
        Nodes in the flown region.
    contributors : sequence of str
        Names of the fits that inform the term.
    history : str
        Line of the history with ``{}`` for the number of contributors.
    """
    shape = leaf["value"].shape
    # A node comes from flight if flights reduced its standard error noticeably.
    from_flight = flown.reshape(shape) & (sd.reshape(shape) < CORRECTED * leaf["stderr"].values)
    if "source" in leaf:
        old_source = leaf["source"].values
    else:
        old_source = np.full(shape, _terms.SOURCES.index("judgement"), np.uint8)
    new = leaf.copy(deep=True)
    new["value"] = leaf["value"].dims, value.reshape(shape), leaf["value"].attrs
    new["stderr"] = leaf["value"].dims, sd.reshape(shape), leaf["stderr"].attrs
    source = np.where(from_flight, _FLIGHT, old_source).astype(np.uint8)
    flags = _terms.source_attributes(source)
    new["source"] = leaf["value"].dims, source, flags
    sentences = [
        str(leaf.attrs.get("comment", "")),
        f"{int(from_flight.sum())} of {from_flight.size} nodes from flight: "
        f"{', '.join(contributors)}.",
    ]
    if set(_terms.list_regressors(leaf)) & {"qhat", "alphadothat"}:
        sentences.append(_COLLINEAR)
    new.attrs["comment"] = " ".join(filter(None, sentences))
    line = history.format(len(contributors))
    if leaf.attrs.get("history"):
        line = f"{leaf.attrs['history']}\n{line}"
    new.attrs["history"] = line
    return new


def contributing_fits(observed: Sequence[Observation], nodes: slice) -> list[str]:
    """Return the names of the fits that inform some of the nodes, such as those of one term.

    A fit that did not move the regressor of a term leaves rounding errors in its columns, and no
    information. The information on a node is the sum of H^2 / C over the estimates of a fit.
    """
    information = []
    for observation in observed:
        variance = np.maximum(np.diag(observation.C), np.finfo(float).tiny)[:, None]
        on_nodes = (observation.H[:, nodes] ** 2 / variance).sum(axis=0)
        information.append(on_nodes)
    largest = np.max(information, axis=0, initial=0.0)
    names = []
    for number, (observation, on_nodes) in enumerate(zip(observed, information)):
        if np.any((on_nodes > 0.0) & (on_nodes > _LEAST_SHARE * largest)):
            names.append(observation.name or f"fit {number}")
    return names


def term_row(name: str, before: xr.Dataset, after: xr.Dataset, weights: np.ndarray) -> pd.DataFrame:
    """Return the row of `Tabulation.report` of a term."""
    prior_stderr = before["stderr"].values.ravel()
    change = (after["value"] - before["value"]).values.ravel()
    # Exact nodes have a standard error of zero: their ratio is 1 and they do not change.
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(prior_stderr > 0, after["stderr"].values.ravel() / prior_stderr, 1.0)
        change_in_sd = np.where(prior_stderr > 0, np.abs(change) / prior_stderr, 0.0)
    row = {
        "nodes": len(ratio),
        "flight": int((after["source"].values == _FLIGHT).sum()),
        "corrected": int((ratio < CORRECTED).sum()),
        "identified": int((ratio < REPLACED).sum()),
        "ratio_least": ratio.min(),
        "ratio_median": np.median(ratio),
        "change_rms": np.sqrt((change**2).mean()),
        "change_largest": change[np.abs(change).argmax()],
        "change_in_sd": change_in_sd.max(),
        "prior_inflation": np.sqrt(weights.sum()),
        **dict(zip(PARTS, weights)),
        "decision": after.attrs["decision"],
        "reason": after.attrs["reason"],
    }
    return pd.DataFrame(row, index=pd.Index([name], name="term"))


def point_rows(
    coefficient: str,
    observed: Sequence[Observation],
    before: Mapping[str, xr.Dataset],
    after: Mapping[str, xr.Dataset],
    distance: np.ndarray,
    weight: np.ndarray,
) -> pd.DataFrame:
    """Return the rows of `Tabulation.points` of a coefficient.

    Parameters
    ----------
    coefficient : str
    observed : sequence of Observation
    before, after : mapping of str to Dataset
        All terms of the coefficient a priori, and with the new nodes.
    distance, weight : array (observations,)
        Distance of each fit from the tables in its standard errors, and its weight.
    """
    rows = []
    for number, observation in enumerate(observed):
        z = observation.data[coefficient].values
        prior = z - _sum_of_terms(observation, before)
        new = z - _sum_of_terms(observation, after)
        clamped = [_share_outside(leaf, observation.data) for leaf in before.values()]
        row = {
            "coefficient": coefficient,
            "fit": observation.name,
            "rms_prior": np.sqrt((prior**2).mean()),
            "rms": np.sqrt((new**2).mean()),
            "range": np.ptp(z),
            "distance": distance[number],
            "weight": weight[number],
            "suspect": bool(weight[number] < SUSPECT),
            "clamped": max(clamped),
        }
        rows.append(row)
    return pd.DataFrame(rows).set_index(["coefficient", "fit"])


def _sum_of_terms(observation: Observation, leaves: Mapping[str, xr.Dataset]) -> np.ndarray:
    """Return the coefficient that tables give at the samples of an observation, (samples,)."""
    return sum(B @ leaves[name]["value"].values.ravel() for name, B in observation.bases.items())


def compatibility_row(coefficient: str, count: int, chi2: float, inflation: float) -> pd.DataFrame:
    """Return the row of `Tabulation.compatibility` of a coefficient."""
    row = {
        "chi2": chi2,
        "count": count,
        "probability": float(scipy.stats.chi2.sf(chi2, count)),
        "inflation": inflation,
    }
    return pd.DataFrame(row, index=pd.Index([coefficient], name="coefficient"))


def _share_outside(leaf: xr.Dataset, data: xr.Dataset) -> float:
    """Return the share of the samples that lie outside the table on some axis."""
    return float(samples_outside(leaf, data).mean())
