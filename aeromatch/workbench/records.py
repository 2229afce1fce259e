"""Page of the records: channels over time, manoeuvres, faults, coverage."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import aerodb
import flighttest
from aerodb.figures.lr743_set.flown import configuration_text, height_text
from aeromatch.workbench.opened import MATCH, OpenProject, decimate_channels, pack_traces
from flightmech.air import atmosphere, impact_pressure_at, mach_number
from flightmech.aircraft.aircraft import read_aircraft
from flightmech.errors import SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.support.figures import to_display_quantity
from flighttest.reconstruction.quality.assessment import assess
from flighttest.records.record import faults

_ENTRY = re.compile(
    r"(?P<name>[^\s=]+) = (?P<value>.+?) +# in \[(?P<leaf>[\w.]+)\] of the name map(?:,.*)?$"
)
"""A line as `flighttest.reconstruction.quality.finding` writes it; behind it may stand for which cause it is."""
_MOST_POINTS = 8000  # of a screen; a request for more is one of another program
_CONDITIONS = ("h", "mach", "alpha", "V_cas", "nz")
_SETTINGS = ("mass", "delta_f", "gear", "speedbrake")
_RECORDED_BY = {"h": "h_baro", "alpha": "alpha_vane"}  # where a record has not been reconstructed


def show_project(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return what the project holds."""
    found = opened.project
    return {
        "title": found.title,
        "file": opened.file.name,
        "folder": str(opened.file.parent),
        "work": str(opened.work),
        "records": [
            {
                "name": name,
                "file": opened.places.named(file),
                "reconstructed": opened.path_file(name).exists(),
            }
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


def manoeuvres_of(opened: OpenProject, name: str) -> tuple[str, pd.DataFrame]:
    """Return where the marks of a record come from (``table`` or ``record``), and the marks."""
    table = opened.project.manoeuvres
    given = (
        opened.kept(("marks",), [table], lambda: flighttest.records.read_manoeuvres(table))
        if table and table.exists()
        else {}
    )
    if name in given:
        return "table", given[name]
    return "record", flighttest.manoeuvres(opened.record(name))


def not_marked(opened: OpenProject, name: str, marks: pd.DataFrame) -> pd.DataFrame:
    """Return the manoeuvres found in the movements of the controls of a record, less those of which
    a mark covers more than half.
    """
    names = opened.project.names
    files = [opened.flight(name), *([names] if names else [])]
    found = opened.kept(
        ("found",), files, lambda: flighttest.manoeuvre_finding.find_manoeuvres(opened.record(name))
    )
    starts, ends = (marks[key].to_numpy(float) for key in ("start", "end"))

    def covered(row: Any) -> bool:
        common = np.minimum(ends, row.end) - np.maximum(starts, row.start)
        return bool(np.any(common > 0.5 * (row.end - row.start)))

    return found[[not covered(row) for row in found.itertuples()]]


def show_record(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return channels, clocks, manoeuvres and faults of the record ``name``; ``find=1`` searches
    for more manoeuvres.

    The marks stand first, in order of time, then what was found and is not marked.
    """
    name = query.get("name", "")
    tree = opened.record(name)
    source, marks = manoeuvres_of(opened, name)
    more = not_marked(opened, name, marks) if query.get("find") == "1" else marks[:0]
    rows = [
        {**row, "found": found}
        for table, found in ((marks, False), (more, True))
        for row in table.to_dict("records")
    ]
    channels = [*_channels(tree), *_path_channels(opened, name)]
    spans = [
        (time[0], time[-1])
        for node in tree.children.values()
        if len(time := node.to_dataset()["time"].values)
    ]
    return {
        "name": name,
        "file": opened.places.named(opened.flight(name)),
        "title": tree.attrs.get("title", ""),
        "start": min(start for start, _ in spans),
        "stop": max(stop for _, stop in spans),
        "channels": channels,
        "manoeuvres": {"source": source, "rows": rows},
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


def _path_channels(opened: OpenProject, name: str) -> list[dict[str, Any]]:
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
    return {"unit": to_display_quantity(name, np.zeros(1))[1], "meaning": known.long_name}


def pack_channels(opened: OpenProject, query: Mapping[str, str], body: Any) -> bytes:
    """Return channels of a record inside a span of time, as `pack_traces`.

    The query has ``name``, ``channels`` (``source/leaf/channel`` with commas), ``start``, ``stop``
    [s] and ``points``.
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
        groups.append(
            (
                {"source": source, "leaf": leaf},
                *decimate_channels(
                    known.time, {one: known[one] for one in names}, start, stop, points
                ),
            )
        )
    return pack_traces(groups)


def _number(query: Mapping[str, str], key: str) -> float:
    try:
        found = float(query.get(key, ""))
    except ValueError:
        found = np.nan
    if not np.isfinite(found):
        raise SchemaError("channels", [f"{key} {query.get(key, '')!r}; give a number"])
    return found


def list_check_findings(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the findings of ``flight check``; ``entries`` are the lines of the name map that a
    remedy is made of.
    """
    name = query.get("name", "")
    files = [
        opened.flight(name),
        opened.project.aircraft,
        *([opened.project.names] if opened.project.names else []),
    ]
    found = opened.kept(
        ("check",), files, lambda: assess(opened.record(name), opened.aircraft).as_dict()
    )
    return {
        "verdict": found["verdict"],
        "findings": [{**one, "entries": parse_remedy(one["remedy"])} for one in found["findings"]],
    }


def parse_remedy(remedy: str) -> list[dict[str, str]]:
    """Return keys and values (TOML) of a remedy that is lines of the name map, for ``aeromatch
    set``; none where it is anything else.
    """
    found = [_ENTRY.match(line.strip()) for line in remedy.split("\n")]
    return (
        [
            {"key": f"{line['leaf']}.{line['name']}", "value": line["value"]}
            for line in found
            if line
        ]
        if all(found)
        else []
    )


def list_test_points(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the test points of the records named (``names`` with commas): mean conditions of every
    manoeuvre ([LR743] fig. 9).

    Conditions come from the reconstructed record, else from the recorded channels of that name: the
    height is that of the altimeter then, the angle of attack that of the vane, the Mach number that
    of calibrated airspeed and height.
    """
    rows = []
    for about, found in _points(opened, query.get("names", "")):
        shown = {name: _shown(name, found[name]) for name in _CONDITIONS if name in found}
        rows.append(
            {
                **about,
                **shown,
                "configuration": configuration_text(
                    pd.Series({**dict.fromkeys(_SETTINGS, 0.0), **found})
                ),
            }
        )
    return {
        "points": rows,
        "units": {name: to_display_quantity(name, np.zeros(1))[1] for name in _CONDITIONS},
    }


def list_one_g_lines(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the 1 g lines of the test points of the records named (``names``), by the last
    database of the match.

    A line is level flight at the mean mass of the test points of one height and configuration.
    """
    model = next(
        (
            name
            for name in ("final", "datcom")
            if all((opened.work / MATCH / f"{name}.{kind}").exists() for kind in ("nc", "toml"))
        ),
        None,
    )
    if model is None:
        return {"lines": [], "model": None, "remarks": []}
    files = [opened.work / MATCH / f"{model}.{kind}" for kind in ("nc", "toml")]
    points = pd.DataFrame(
        [found for _, found in _points(opened, query.get("names", ""))],
        columns=[*_CONDITIONS, *_SETTINGS],
        dtype=float,
    )

    def make() -> tuple[dict[str, xr.Dataset], list[str]]:
        db = opened.kept(("database",), files[:1], lambda: aerodb.open(files[0]))
        return aerodb.figures.one_g_lines(db, read_aircraft(files[1]), points)

    found, remarks = opened.kept(("one g", points.to_json()), files, make, 4)
    lines = []
    for line in found.values():
        own = line.isel(mach=np.isfinite(line["alpha"].values))
        curves = {
            name: to_display_quantity(name, own[name].values)[0]
            for name in ("mach", "alpha", "V_cas")
        }
        words = {
            "h": height_text(line.attrs["h"]),
            "mass": round(line.attrs["mass"], -1),
            "configuration": line.attrs["configuration"],
        }
        lines.append({**words, **curves})
    return {"lines": lines, "model": model, "remarks": remarks}


def _points(opened: OpenProject, names: str) -> list[tuple[dict[str, Any], dict[str, float]]]:
    """Return of every manoeuvre of the records named what it is, and the means of its conditions.
    [SI]
    """
    rows = []
    for name in filter(None, names.split(",")):
        _, marks = manoeuvres_of(opened, name)
        data = (
            [opened.path(name).states]
            if opened.path_file(name).exists()
            else [n.to_dataset() for n in opened.record(name).children.values()]
        )
        for mark in marks.to_dict("records"):
            about = {
                "record": name,
                "manoeuvre": mark["manoeuvre"],
                "control": mark["control"],
                "start": mark["start"],
                "end": mark["end"],
            }
            rows.append((about, _conditions(data, float(mark["start"]), float(mark["end"]))))
    return rows


def _conditions(data: list[Any], start: float, end: float) -> dict[str, float]:
    """Return the means over a span of time of the conditions that the data hold, else of what they
    are recorded by. [SI]
    """
    found = {}
    for name in (*_CONDITIONS, *_SETTINGS):
        own = next(
            (one for one in (name, _RECORDED_BY.get(name)) if any(one in leaf for leaf in data)),
            None,
        )
        if own is None:
            continue
        part = next(leaf for leaf in data if own in leaf)[own].sel(time=slice(start, end)).values
        if len(part) and np.isfinite(part).any():
            found[name] = float(np.nanmean(part))
    if "mach" not in found and {"V_cas", "h"} <= found.keys():
        found["mach"] = float(
            mach_number(impact_pressure_at(found["V_cas"]), atmosphere(found["h"]).p_static)
        )
    return found


def _shown(name: str, value: float) -> float:
    return float(to_display_quantity(name, np.array([value]))[0][0])


ROUTES = {
    ("GET", "/api/project"): show_project,
    ("GET", "/api/record"): show_record,
    ("GET", "/api/channels"): pack_channels,
    ("GET", "/api/check"): list_check_findings,
    ("GET", "/api/coverage"): list_test_points,
    ("GET", "/api/one_g"): list_one_g_lines,
}
"""What the page of the records requests: (method, path) -> call with project, query and JSON body; gives data, or bytes as they are."""
