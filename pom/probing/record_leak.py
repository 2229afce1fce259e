"""Whether the flight of a case identified the model that it is to prove.

A database and the models compiled from it keep the samples of every window that entered it
(`flightmech.flown_samples`).  They are compared with the flight of the case, over its
window: file names do not show a copy.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
import xarray as xr

from flightmech.errors import AeromatchError
from flightmech.flown_samples import (
    CHANNELS,
    FLOWN_SAMPLES,
    LEAST_CHANNELS,
    LEAST_OVERLAP,
    SMOOTHED,
    SharedWindow,
    find_shared_windows,
    unpack_windows,
)
from flightmech.simulation.compiler import SimModel
from pom.cases.case import PomCase
from pom.judging.beyond_the_bands import flown_model
from pom.tolerances.bands import RowRemark

_FLIGHT = ("identified from flight", "tabulate", "regress_tables", "join_submodels")
"""Words in the history of a database whose tables are from flight."""
_FLOWN_NODES = re.compile(r"\bflight [1-9]")
"""Number of nodes from flight in the sources of a term."""
_MOST = 3  # windows that a remark names


_UNKNOWN = "record not compared with those that identified"


@lru_cache(maxsize=32)
def _read_windows(fmu: Path, sha256: str) -> tuple[str, RowRemark | None]:
    """Return the windows that identified a model as text, or the remark that they are unknown.

    Both are empty for a model that is not from flight; `sha256` is a key.
    """
    try:
        model = flown_model(fmu)
    except AeromatchError as error:
        return "", RowRemark("not_checked", f"not checked: {_UNKNOWN}: {error}")
    if model is None:
        text = f"not checked: {_UNKNOWN}: the FMU does not hold the samples that identified it"
        return "", RowRemark("not_checked", text)
    attributes = model.meta.get("database", {})
    text = str(attributes.get(FLOWN_SAMPLES, ""))
    if unpack_windows(text):
        return text, None
    if text or _is_from_flight(attributes.get("history", "")) or _has_flown_nodes(model):
        # a database of this program keeps its samples, unless they were taken out
        reason = (
            f"departure: {_UNKNOWN}: the tables are from flight, and the database of the model has "
            f"no samples of it; compile the database as identified"
        )
        return "", RowRemark("departure", reason)
    return "", None


def _has_flown_nodes(model: SimModel) -> bool:
    """Return whether a term of a model states nodes from flight among its sources."""
    texts = [str(item.get("source", "")) for item in model.meta.get("terms", {}).values()]
    return any(_FLOWN_NODES.search(text) for text in texts)


@lru_cache(maxsize=64)
def _compare(text: str, names: tuple[str, ...], content: bytes) -> tuple[SharedWindow, ...]:
    """Return the windows that hold samples of a flight; models of one origin share the result.

    `content` holds the time and the channels `names` of the flight, one after the other.
    """
    rows = np.frombuffer(content).reshape(len(names) + 1, -1)
    channels = dict(zip(names, rows[1:], strict=True))
    return tuple(find_shared_windows(unpack_windows(text), rows[0], channels))


def _is_from_flight(history: str) -> bool:
    return any(word in history for word in _FLIGHT)


def find_leaks(case: PomCase, states: xr.Dataset, fmu: Path, sha256: str) -> tuple[RowRemark, ...]:
    """Return the remark on a flight that identified a model.

    Parameters
    ----------
    case : PomCase
    states : Dataset (time)
        Of the flight over the window of the case.
    fmu : Path
    sha256 : str
        Of the FMU.

    Returns
    -------
    tuple of RowRemark
        Of kind ``leak`` with every window, ``probe`` with the result of the check,
        ``not_checked`` for an FMU of another program and for a flight that is too short, or
        ``departure`` for tables from flight without their samples.
    """
    windows, unknown = _read_windows(fmu, sha256)
    if unknown is not None:
        return (unknown,)
    if not windows:
        return (RowRemark("probe", "the tables of the model are not from flight"),)
    channels = {name: states[name].values for name in CHANNELS if name in states}
    time = states["time"].values.astype(float)
    held = {name: np.asarray(item, float) for name, item in channels.items() if np.ndim(item)}
    reason = _too_little_text(time, held)
    if reason:
        text = f"not checked: shared samples with the windows that identified the model ({reason})"
        return (RowRemark("not_checked", text),)
    content = np.concatenate([time, *held.values()]).tobytes()
    shared = _compare(windows, tuple(held), content)
    if shared:
        return (_leak_remark(case, shared),)
    count = len(unpack_windows(windows))
    text = f"no samples shared with the {count} windows that identified the model"
    return (RowRemark("probe", text),)


def _too_little_text(time: np.ndarray, held: Mapping[str, np.ndarray]) -> str:
    """Return why a flight is too short or has too few channels for a comparison; else empty."""
    if len(held) < LEAST_CHANNELS:
        return f"the flight has {len(held)} of {', '.join(CHANNELS)}, {LEAST_CHANNELS} are needed"
    is_finite = np.isfinite([*held.values()]).all(axis=0)
    duration = float(np.ptp(time[is_finite])) if is_finite.any() else 0.0
    least = LEAST_OVERLAP + SMOOTHED
    if duration < least:
        return f"the window has {duration:.3g} s of it, {least:g} s are needed"
    return ""


def _leak_remark(case: PomCase, shared: Sequence[SharedWindow]) -> RowRemark:
    """Return the remark that names the windows, the longest first."""
    ordered = sorted(shared, key=lambda item: item.start - item.stop)
    text = (
        f"leak: {_list_windows(ordered[:_MOST])} identified the model and cannot prove case "
        f"{case.name} too"
    )
    if len(ordered) > _MOST:
        text += f"; {len(ordered) - _MOST} more windows"
    values = {"correlation": ordered[0].correlation, "windows": float(len(ordered))}
    return RowRemark("leak", text, values=values, unit="1")


def _list_windows(windows: Iterable[SharedWindow]) -> str:
    texts = []
    for item in windows:
        texts.append(
            f"{item.start:.1f} ... {item.stop:.1f} s of the record ({item.source}, correlation "
            f"{item.correlation:.4f} of {', '.join(item.channels)})"
        )
    return "; ".join(dict.fromkeys(texts))
