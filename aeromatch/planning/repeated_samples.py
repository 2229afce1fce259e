"""Samples of one flight that are there twice, because a record is there twice.

A copy under another name halves the variance of what it identifies without any information.  A copy
that proves what its samples identified proves nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations

import numpy as np
import xarray as xr

from aeromatch.project.model_sections import FitSection
from flighttest.records.shared_samples import LEAST_SAMPLES, inertial_channels, sample_hashes
from flighttest.regression.equation_error.model import RegressionModel
from pom.cases.case import PomCase

Samples = Mapping[str, np.ndarray]
"""Hashes of samples by the coefficient or submodel that they identify."""


def used_samples(
    fits: Mapping[str, FitSection],
    record: xr.DataTree,
    spans: Mapping[str, Sequence[tuple[float, float]]],
) -> dict[str, np.ndarray]:
    """Return the hashes of the samples of a record, by what they identify.

    Parameters
    ----------
    fits : mapping of str to FitSection
        By position.
    record : DataTree
    spans : mapping
        Windows by the position of a fit or submodel. [s]

    Returns
    -------
    dict of str to array of uint64
        By coefficient, and by position of a submodel.
    """
    time, hashes = sample_hashes(inertial_channels(record))
    # by target: the windows that identify it
    uses: dict[str, list[tuple[float, float]]] = {}
    for position, windows in spans.items():
        targets = [position]
        if position in fits:
            models = map(RegressionModel.parse, fits[position].models)
            targets = list(dict.fromkeys(model.coefficient for model in models))
        for target in targets if windows else ():
            uses.setdefault(target, []).extend(windows)
    # Most coefficients share their windows. They share one array, which is stored once.
    arrays: dict[tuple[tuple[float, float], ...], np.ndarray] = {}
    samples = {}
    for target, used in uses.items():
        key = tuple(used)
        if key not in arrays:
            inside = [hashes[(time >= start) & (time < end)] for start, end in used]
            arrays[key] = np.unique(np.concatenate(inside))
        samples[target] = arrays[key]
    return samples


def proving_samples(cases: Iterable[PomCase], record: xr.DataTree) -> dict[str, np.ndarray]:
    """Return the hashes of the samples of a record in the window of each case, by its name.

    Parameters
    ----------
    cases : iterable of PomCase
        Cases that replay the record.
    record : DataTree
    """
    time, hashes = sample_hashes(inertial_channels(record))
    samples = {}
    for case in cases:
        start, stop = case.window
        samples[case.name] = np.unique(hashes[(time >= start) & (time <= stop)])
    return samples


def _common_count(by_record: Mapping[str, Sequence[np.ndarray]]) -> int:
    """Return the number of hashes that more than one record has.

    It is the upper limit of the common samples of any two records. One sort of all hashes replaces
    the comparison of each pair in flights without a copy, which are nearly all.
    """
    records = [np.unique(np.concatenate(arrays)) for arrays in by_record.values() if arrays]
    if len(records) < 2:
        return 0
    hashes = np.sort(np.concatenate(records))
    return int(np.unique(hashes[1:][hashes[1:] == hashes[:-1]]).size)


def leaked_sample_problems(
    samples: Mapping[str, Samples], proofs: Mapping[str, Samples]
) -> list[str]:
    """Return a line for every case whose samples identify under the name of another record.

    Parameters
    ----------
    samples : mapping of str to mapping
        Results of `used_samples` by record.
    proofs : mapping of str to mapping
        Results of `proving_samples` by record.
    """
    problems: list[str] = []
    by_record = {name: [*used.values()] for name, used in samples.items()}
    for name, by_case in proofs.items():
        by_record.setdefault(name, []).extend(by_case.values())
    if _common_count(by_record) <= LEAST_SAMPLES:
        return problems
    for proving, by_case in proofs.items():
        for case, proof in by_case.items():
            for record, used in samples.items():
                # two windows of one record are compared by their times
                if record == proving:
                    continue
                counts = {}
                for target, hashes in used.items():
                    common = np.intersect1d(hashes, proof, assume_unique=True)
                    counts[target] = common.size
                targets = [target for target, count in counts.items() if count > LEAST_SAMPLES]
                if targets:
                    problems.append(
                        f"case {case}: {max(counts.values())} samples of its record {proving} are "
                        f"samples of record {record}, which identify {', '.join(targets)}; what "
                        f"identifies a model cannot prove it: prove with another flight, or take "
                        f"that manoeuvre out of the fits"
                    )
    return problems


def repeated_sample_problems(samples: Mapping[str, Samples]) -> list[str]:
    """Return a line for every two records with common samples that identify one thing.

    Parameters
    ----------
    samples : mapping of str to mapping
        Results of `used_samples` by record.
    """
    problems: list[str] = []
    by_record = {name: [*used.values()] for name, used in samples.items()}
    if _common_count(by_record) <= LEAST_SAMPLES:
        return problems
    for (first, one), (second, other) in combinations(samples.items(), 2):
        counts = {}
        for target in one:
            if target in other:
                common = np.intersect1d(one[target], other[target], assume_unique=True)
                counts[target] = common.size
        targets = [target for target, count in counts.items() if count > LEAST_SAMPLES]
        if targets:
            problems.append(
                f"record {second}: {max(counts.values())} samples in its windows are samples of "
                f"record {first}, and both identify {', '.join(targets)}: they count twice, and "
                f"standard errors are too small; take one of both records out of the fits"
            )
    return problems
