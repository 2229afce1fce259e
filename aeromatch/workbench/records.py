"""Page of the records: channels over time, manoeuvres, faults, coverage."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

import flighttest
from flightmech.errors import SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.support.display import displayed
from flighttest.quality.assessment import assess
from flighttest.records.record import faults

from .levels import packed, traces
from .opened import Opened

_MOST_POINTS = 8000  # of a screen; a request for more is one of another program
_CONDITIONS = ("h", "mach", "alpha", "V_cas", "nz")


def project(opened: Opened, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return what the project holds."""
    found = opened.project
    return {
        "title": found.title,
        "file": opened.file.name,
        "folder": str(opened.file.parent),
        "work": str(opened.work),
        "records": [
            {"name": name, "file": opened.places.named(file), "reconstructed": opened.path_file(name).exists()}
            for name, file in found.flights.items()
        ],
        "cases": [opened.places.named(file) for file in found.cases],
        "fits": [
            {
                "name": fit.name,
                "records": fit.records,
                "manoeuvres": fit.manoeuvres,
                "models": fit.models,
                "window": getattr(fit, "window", None),
            }
            for fit in found.fits
        ],
        "aircraft": opened.places.named(found.aircraft),
        "names": opened.places.named(found.names) if found.names else None,
        "manoeuvres": opened.places.named(found.manoeuvres) if found.manoeuvres else None,
        "cutoff": found.cutoff,
        "tabulation": found.tabulation,
        "held": found.held,
    }


def manoeuvres_of(opened: Opened, name: str, find: bool = False) -> tuple[str, pd.DataFrame]:
    """Return where the marks of a record come from (``table``, ``record``, or with `find` ``found``), and the marks."""
    table = opened.project.manoeuvres
    given = opened.kept(("marks",), [table], lambda: flighttest.records.read_manoeuvres(table)) if table and table.exists() else {}
    if name in given:
        return "table", given[name]
    record = opened.record(name)
    own = flighttest.manoeuvres(record)
    if len(own) or not find:
        return "record", own
    found = opened.kept(("found",), [opened.flight(name)], lambda: flighttest.manoeuvre_finding.find_manoeuvres(record))
    return "found", found


def record(opened: Opened, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return channels, clocks, manoeuvres and faults of the record ``name``; ``find=1`` searches manoeuvres where none are marked."""
    name = query.get("name", "")
    tree = opened.record(name)
    source, marks = manoeuvres_of(opened, name, query.get("find") == "1")
    channels = [*_channels(tree), *_path_channels(opened, name)]
    spans = [(time[0], time[-1]) for node in tree.children.values() if len(time := node.to_dataset()["time"].values)]
    return {
        "name": name,
        "file": opened.places.named(opened.flight(name)),
        "title": tree.attrs.get("title", ""),
        "start": min(start for start, _ in spans),
        "stop": max(stop for _, stop in spans),
        "channels": channels,
        "manoeuvres": {"source": source, "rows": marks.to_dict("records")},
        "faults": faults(tree),
        "reconstructed": opened.path_file(name).exists(),
    }


def _channels(tree: Any) -> list[dict[str, Any]]:
    return [
        {"source": "record", "leaf": leaf, "channel": str(name), **_about(str(name))}
        for leaf, node in tree.children.items()
        for name, item in node.data_vars.items()
        if item.dims == ("time",)
    ]


def _path_channels(opened: Opened, name: str) -> list[dict[str, Any]]:
    if not opened.path_file(name).exists():
        return []
    states = opened.path(name).states
    return [
        {"source": "path", "leaf": "path", "channel": str(own), **_about(str(own))}
        for own, item in states.data_vars.items()
        if item.dims == ("time",) and item.dtype.kind in "fiub"
    ]


def _about(name: str) -> dict[str, str]:
    try:
        known = lookup(name)
    except UnknownName:
        return {"unit": "", "meaning": ""}
    return {"unit": displayed(name, np.zeros(1))[1], "meaning": known.long_name}


def channels(opened: Opened, query: Mapping[str, str], body: Any) -> bytes:
    """Return channels of a record inside a span of time, as `packed`.

    The query has ``name``, ``channels`` (``source/leaf/channel`` with commas), ``start``, ``stop`` [s] and ``points``.
    """
    name = query.get("name", "")
    start, stop = (_number(query, key) for key in ("start", "stop"))
    points = int(min(max(_number(query, "points"), 1), _MOST_POINTS))
    wanted: dict[tuple[str, str], list[str]] = {}
    for text in filter(None, query.get("channels", "").split(",")):
        source, _, rest = text.partition("/")
        leaf, _, channel = rest.partition("/")
        wanted.setdefault((source, leaf), []).append(channel)
    groups: list[tuple[dict[str, object], np.ndarray, dict[str, np.ndarray]]] = []
    for (source, leaf), names in wanted.items():
        if source not in ("record", "path"):
            raise SchemaError("channels", [f"source {source!r}; record or path"])
        found = opened.levels(name, source)
        if leaf not in found:
            raise UnknownName(leaf, found, "leaf")
        known = found[leaf]
        if missing := [one for one in names if one not in known]:
            raise UnknownName(missing[0], known, "channel")
        groups.append(({"source": source, "leaf": leaf}, *traces(known.time, {one: known[one] for one in names}, start, stop, points)))
    return packed(groups)


def _number(query: Mapping[str, str], key: str) -> float:
    try:
        found = float(query.get(key, ""))
    except ValueError:
        found = np.nan
    if not np.isfinite(found):
        raise SchemaError("channels", [f"{key} {query.get(key, '')!r}; give a number"])
    return found


def check(opened: Opened, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the findings of ``flight check``."""
    name = query.get("name", "")
    files = [opened.flight(name), opened.project.aircraft, *([opened.project.names] if opened.project.names else [])]
    found = opened.kept(("check",), files, lambda: assess(opened.record(name), opened.aircraft).as_dict())
    return {"verdict": found["verdict"], "findings": found["findings"]}


def coverage(opened: Opened, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the test points of the records named (``names`` with commas): mean conditions of every manoeuvre ([LR743] fig. 9).

    Conditions come from the reconstructed record, else from the recorded channels of that name.
    """
    rows = []
    for name in filter(None, query.get("names", "").split(",")):
        _, marks = manoeuvres_of(opened, name)
        data = (
            [opened.path(name).states]
            if opened.path_file(name).exists()
            else [n.to_dataset() for n in opened.record(name).children.values()]
        )
        for mark in marks.to_dict("records"):
            about = {"record": name, "manoeuvre": mark["manoeuvre"], "control": mark["control"], "start": mark["start"], "end": mark["end"]}
            rows.append({**about, **_conditions(data, float(mark["start"]), float(mark["end"]))})
    units = {name: displayed(name, np.zeros(1))[1] for name in _CONDITIONS}
    return {"points": rows, "units": units}


def _conditions(data: list[Any], start: float, end: float) -> dict[str, float]:
    found = {}
    for name in _CONDITIONS:
        leaf = next((one for one in data if name in one), None)
        if leaf is None and name == "alpha":
            leaf, name = next((one for one in data if "alpha_vane" in one), None), "alpha_vane"
        if leaf is None:
            continue
        part = leaf[name].sel(time=slice(start, end)).values
        if len(part) and np.isfinite(part).any():
            value = float(displayed(name, np.array([np.nanmean(part)]))[0][0])
            found["alpha" if name == "alpha_vane" else name] = value
    return found


ROUTES = {
    ("GET", "/api/project"): project,
    ("GET", "/api/record"): record,
    ("GET", "/api/channels"): channels,
    ("GET", "/api/check"): check,
    ("GET", "/api/coverage"): coverage,
}
"""What the page of the records requests: (method, path) -> call with project, query and JSON body; gives data, or bytes as they are."""
