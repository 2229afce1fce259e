"""Whether a model has used a window of a record: names, times and content of the records.

Values of a coefficient do not show it: another low-pass, another aircraft file or another
reconstruction changes all of them, and the data remain those of the fit.  So a model carries the
names of its records, the ends of its windows and a hash of the reconstructed states.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import replace
from hashlib import sha256
from typing import NamedTuple, TypeVar

import numpy as np
import xarray as xr

from flightmech.quantities import time_text
from flighttest.maximum_likelihood.result import OutputError
from flighttest.reconstruction.dynamics.saved_paths import open_states
from flighttest.regression.equation_error.fit import Fit

WINDOWS = "windows"
"""Attribute of the estimates: the windows as JSON, [record, start, stop, digest] of each. [s]"""
USED = "in the fit"
"""Beginning of the remark on a window that the fit has used."""
UNKNOWN = "windows of the fit not known"
"""Beginning of the remark on a window that the fit may have used."""
# Difference of equal times, from the rounding of a file. [s]
_SAME_TIME = 1e-6

Model = TypeVar("Model", Fit, OutputError)


class ValidationWindow(NamedTuple):
    """A stretch of a record that models predict.

    Attributes
    ----------
    record : str
    data : Dataset (time,)
        Coefficients and states, as from `flighttest.coefficients`. [SI]
    digest : str
        Hash of the whole record, as from `digest_states`; empty if it is not known.
    """

    record: str
    data: xr.Dataset
    digest: str = ""

    @property
    def name(self) -> str:
        """Record and times."""
        time = self.data["time"].values
        return f"{self.record} {time_text(time[0])}-{time_text(time[-1])} s"


class WindowUse(NamedTuple):
    """Whether a window counts for a model.

    Attributes
    ----------
    counts : bool
        No sample of it is known to be in the fit, or may be.
    remark : str
        What is known; empty without a doubt.
    """

    counts: bool
    remark: str


def digest_states(states: xr.Dataset) -> str:
    """Return a hash of the numbers of a reconstructed record, whatever the name of its file."""
    digest = sha256()
    names = [str(name) for name in states.variables if states[name].dtype.kind in "fiub"]
    for name in sorted(names):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(states[name].values, dtype=float).tobytes())
    return digest.hexdigest()


def digest_record(path: str | os.PathLike) -> str:
    """Return the hash of the states of a reconstruction file."""
    return digest_states(open_states(path))


def state_windows(model: Model, windows: Iterable[ValidationWindow]) -> Model:
    """Return a model with the windows that it has used, for its file."""
    used = []
    for window in windows:
        time = window.data["time"].values
        used.append([window.record, float(time[0]), float(time[-1]), window.digest])
    estimates = model.estimates.assign_attrs({WINDOWS: json.dumps(used)})
    return replace(model, estimates=estimates)


def find_use(model: Fit | OutputError, window: ValidationWindow) -> WindowUse:
    """Return whether a window counts for a model.

    A model with the names of its windows has used a sample if record or digest are the same and
    the time is inside. Without names the times alone are compared, as far as the model has them: a
    sample at a time of the fit may be in it, so the window does not count.
    """
    stated = _stated_windows(model)
    used = _count_same_samples(model, window)
    if stated is not None:
        used = max(used, _count_inside(stated, window))
    if used:
        return WindowUse(False, f"{USED}: {used} samples of the window; it validates nothing")
    if stated is not None:
        return WindowUse(True, "")
    if isinstance(model, OutputError) or "time" not in model.data:
        return WindowUse(False, f"{UNKNOWN}: the window may be among them; it is not counted")
    common = _count_common_times(model.data["time"].values, window)
    if common:
        text = f"{common} samples of the window have times of the fit; it is not counted"
        return WindowUse(False, f"{UNKNOWN}: {text}")
    return WindowUse(True, "records of the fit not known; its samples have other times")


def _stated_windows(model: Fit | OutputError) -> list[tuple[str, float, float, str]] | None:
    """Return the windows that a model carries, or nothing if it has none that can be read."""
    text = str(model.estimates.attrs.get(WINDOWS, ""))
    stated = []
    try:
        for record, start, stop, *digest in json.loads(text):
            stated.append((str(record), float(start), float(stop), str(*digest)))
    except (ValueError, TypeError):
        return None
    return stated or None


def _count_inside(stated: Iterable[tuple[str, float, float, str]], window: ValidationWindow) -> int:
    time = window.data["time"].values
    is_used = np.zeros(len(time), bool)
    for record, start, stop, digest in stated:
        is_same = record == window.record or (digest != "" and digest == window.digest)
        if is_same:
            is_used |= (time >= start - _SAME_TIME) & (time <= stop + _SAME_TIME)
    return int(is_used.sum())


def _count_same_samples(model: Fit | OutputError, window: ValidationWindow) -> int:
    """Return the number of samples whose time and coefficient are those of a regression.

    They are in the fit, whatever the name of the record.
    """
    if isinstance(model, OutputError):
        return 0
    coefficient, data = model.model.coefficient, window.data
    if "time" not in model.data or coefficient not in data or coefficient not in model.data:
        return 0

    def keys(samples: xr.Dataset) -> set[tuple[float, float]]:
        values = samples[coefficient].values.astype(float)
        return set(zip(np.round(samples["time"].values, 6), np.round(values, 12), strict=True))

    return len(keys(model.data) & keys(data))


def _count_common_times(fitted: np.ndarray, window: ValidationWindow) -> int:
    """Return the number of samples of a window within half its step of a sample of a fit."""
    time = window.data["time"].values.astype(float)
    known = np.sort(np.asarray(fitted, float))
    known = known[np.isfinite(known)]
    if not len(known):
        return len(time)
    reach = _SAME_TIME
    if len(time) > 1:
        reach += 0.5 * float(np.median(np.diff(time)))
    after = np.clip(np.searchsorted(known, time), 1, len(known)) - 1
    following = np.minimum(after + 1, len(known) - 1)
    distance = np.minimum(np.abs(time - known[after]), np.abs(time - known[following]))
    return int((distance <= reach).sum())
