"""Page of the records: channels over time, manoeuvres, faults, coverage."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import aerodb
import flighttest
from aerodb.figures.lr743_set.flown import height_text
from aeromatch.workbench.channels.signals import residuals_of
from aeromatch.workbench.channels.views import ROUTES as CHANNEL_ROUTES
from aeromatch.workbench.channels.views import number_of, pack_expressions
from aeromatch.workbench.opened import MATCH, OpenProject, decimate_channels, pack_traces
from flightmech.air import atmosphere, impact_pressure_at, mach_number
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.aircraft.controls import ICE
from flightmech.envelope.maps import configuration_text
from flightmech.errors import SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.support.figures import to_display_quantity
from flighttest.reconstruction.quality.assessment import assess
from flighttest.records.record import faults

_ENTRY = re.compile(
    r"(?P<name>[^\s=]+) = (?P<value>.+?) +# in \[(?P<leaf>[\w.]+)\] of the name map(?:,.*)?$"
)
"""A line of `flighttest.reconstruction.quality.finding`, with or without a cause after a comma."""
# Greatest number of points of a screen.
_MOST_POINTS = 8000
_CONDITIONS = ("h", "mach", "alpha", "V_cas", "nz")
_SETTINGS = ("mass", "delta_f", "gear", "speedbrake", ICE)
# Recorded channels in place of the states of a record that is not reconstructed.
_RECORDED_BY = {"h": "h_baro", "alpha": "alpha_vane"}


def show_project(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the content of the project."""
    project = opened.project
    records = []
    for name, file in project.flights.items():
        is_reconstructed = opened.path_file(name).exists()
        location = opened.places.named(file)
        records.append({"name": name, "file": location, "reconstructed": is_reconstructed})
    fits = []
    for fit in project.fit:
        entry = {
            "name": fit.name,
            "records": fit.records,
            "manoeuvres": fit.manoeuvres,
            "models": fit.models,
            "window": fit.window,
        }
        fits.append(entry)
    return {
        "title": project.title,
        "file": opened.file.name,
        "folder": str(opened.file.parent),
        "work": str(opened.work),
        "records": records,
        "cases": [opened.places.named(file) for file in project.cases],
        "fits": fits,
        "aircraft": opened.places.named(project.aircraft),
        "names": _optional_place(opened, project.names),
        "manoeuvres": _optional_place(opened, project.manoeuvres),
        "cutoff": project.cutoff,
        "tabulation": project.tabulation,
        "held": project.held,
    }


def _optional_place(opened: OpenProject, file: Path | None) -> str | None:
    if file is None:
        return None
    return opened.places.named(file)


def manoeuvres_of(opened: OpenProject, name: str) -> tuple[str, pd.DataFrame]:
    """Return the source of the marks of a record (``table`` or ``record``), and the marks."""
    file = opened.project.manoeuvres
    if file and file.exists():
        tables = opened.kept(("marks",), [file], lambda: flighttest.records.read_manoeuvres(file))
        if name in tables:
            return "table", tables[name]
    return "record", flighttest.records.marked_manoeuvres(opened.record(name))


def not_marked(opened: OpenProject, name: str, marks: pd.DataFrame) -> pd.DataFrame:
    """Return the manoeuvres in the movements of the controls that have no mark.

    A manoeuvre is marked if a mark covers more than half of it.
    """
    find = flighttest.manoeuvre_finding.find_manoeuvres
    files = opened.record_files(name)
    manoeuvres = opened.kept(("found",), files, lambda: find(opened.record(name)))
    starts, ends = (marks[key].to_numpy(float) for key in ("start", "end"))
    is_unmarked = []
    for start, end in manoeuvres[["start", "end"]].to_numpy(float):
        common = np.minimum(ends, end) - np.maximum(starts, start)
        is_unmarked.append(not np.any(common > 0.5 * (end - start)))
    return manoeuvres[is_unmarked]


def show_record(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return channels, clocks, manoeuvres and faults of the record ``name``.

    With ``find=1`` the manoeuvres without a mark follow the marks.
    """
    name = query.get("name", "")
    tree = opened.record(name)
    source, marks = manoeuvres_of(opened, name)
    rows = [{**row, "found": False} for row in marks.to_dict("records")]
    if query.get("find") == "1":
        unmarked = not_marked(opened, name, marks)
        rows += [{**row, "found": True} for row in unmarked.to_dict("records")]
    starts, stops = [], []
    for node in tree.children.values():
        time = node.to_dataset()["time"].values
        if len(time):
            starts.append(time[0])
            stops.append(time[-1])
    return {
        "name": name,
        "file": opened.places.named(opened.flight(name)),
        "title": tree.attrs.get("title", ""),
        "start": min(starts),
        "stop": max(stops),
        "channels": [*_record_channels(tree), *_path_channels(opened, name)],
        "manoeuvres": {"source": source, "rows": rows},
        "faults": faults(tree),
        "reconstructed": opened.path_file(name).exists(),
        "residuals": _residual_names(opened, name),
        "clock": tree.attrs.get("start", ""),
    }


def _residual_names(opened: OpenProject, name: str) -> list[str]:
    """Return the readings of which the reconstruction has stored what it leaves over."""
    if not opened.path_file(name).exists():
        return []
    residuals = residuals_of(opened, name)
    return [] if residuals is None else [str(channel) for channel in residuals.data_vars]


def _record_channels(tree: Any) -> list[dict[str, Any]]:
    channels = []
    for leaf, node in tree.children.items():
        for name, item in node.data_vars.items():
            if item.dims == ("time",):
                head = {"source": "record", "leaf": leaf, "channel": str(name)}
                channels.append({**head, **_unit_and_meaning(str(name))})
    return channels


def _path_channels(opened: OpenProject, name: str) -> list[dict[str, Any]]:
    if not opened.path_file(name).exists():
        return []
    channels = []
    for channel, item in opened.path(name).states.data_vars.items():
        # Texts and times cannot be drawn.
        if item.dims == ("time",) and item.dtype.kind in "fiub":
            head = {"source": "path", "leaf": "path", "channel": str(channel)}
            channels.append({**head, **_unit_and_meaning(str(channel))})
    return channels


def _unit_and_meaning(name: str) -> dict[str, str]:
    try:
        quantity = lookup(name)
    except UnknownName:
        return {"unit": "", "meaning": ""}
    return {"unit": _display_unit(name), "meaning": quantity.long_name}


def _display_unit(name: str) -> str:
    return to_display_quantity(name, np.zeros(1))[1]


def pack_channels(opened: OpenProject, query: Mapping[str, str], body: Any) -> bytes:
    """Return channels of a record inside a span of time, in the form of `pack_traces`.

    The query has ``name``, ``channels`` (``source/leaf/channel`` with commas), ``start``, ``stop``
    [s] and ``points``; it may have ``lines``, a JSON of expressions of channels.
    """
    name = query.get("name", "")
    start, stop = (number_of(query, key) for key in ("start", "stop"))
    points = int(min(max(number_of(query, "points"), 1), _MOST_POINTS))
    # The channels of one clock are one group.
    requested: dict[tuple[str, str], list[str]] = {}
    for text in filter(None, query.get("channels", "").split(",")):
        source, leaf, channel = [*text.split("/", 2), "", ""][:3]
        requested.setdefault((source, leaf), []).append(channel)
    groups = pack_expressions(opened, query, start=start, stop=stop, points=points)
    for (source, leaf), names in requested.items():
        if source not in ("record", "path"):
            raise SchemaError("channels", [f"source {source!r}; record or path"])
        leaves = opened.levels(name, source)
        if leaf not in leaves:
            raise UnknownName(leaf, leaves, "leaf")
        clock = leaves[leaf]
        for channel in names:
            if channel not in clock:
                raise UnknownName(channel, clock, "channel")
        levels = {channel: clock[channel] for channel in names}
        times, values = decimate_channels(clock.time, levels, start=start, stop=stop, points=points)
        groups.append(({"source": source, "leaf": leaf}, times, values))
    return pack_traces(groups)


def list_check_findings(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the findings of ``flight check``.

    ``entries`` are the lines of the name map in a remedy.
    """
    name = query.get("name", "")
    files = [*opened.record_files(name), *opened.aircraft_files]
    check = opened.kept(
        ("check",), files, lambda: assess(opened.record(name), opened.aircraft).as_dict()
    )
    findings = []
    for finding in check["findings"]:
        findings.append({**finding, "entries": parse_remedy(finding["remedy"])})
    return {"verdict": check["verdict"], "findings": findings}


def parse_remedy(remedy: str) -> list[dict[str, str]]:
    """Return keys and values (TOML) of a remedy for ``aeromatch set``.

    The result is empty, unless all lines of the remedy are lines of the name map.
    """
    entries = []
    for text in remedy.split("\n"):
        line = _ENTRY.match(text.strip())
        if line is None:
            return []
        entries.append({"key": f"{line['leaf']}.{line['name']}", "value": line["value"]})
    return entries


def list_test_points(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the test points of records (``names`` with commas).

    A test point has the mean conditions of a manoeuvre ([LR743] fig. 9). The conditions are states
    of the reconstructed record. Without a reconstruction they are recorded channels: the height of
    the altimeter, the angle of attack of the vane, and the Mach number of calibrated airspeed and
    height.
    """
    rows = []
    for manoeuvre, means in _test_points(opened, query.get("names", "")):
        row = dict(manoeuvre)
        for name in _CONDITIONS:
            if name in means:
                row[name] = float(to_display_quantity(name, np.array([means[name]]))[0][0])
        # A device without a channel is at rest.
        settings = {**dict.fromkeys(_SETTINGS, 0.0), **means}
        row["configuration"] = configuration_text(settings)
        rows.append(row)
    return {"points": rows, "units": {name: _display_unit(name) for name in _CONDITIONS}}


def list_one_g_lines(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the 1 g lines of the test points of records (``names``), by the last database.

    A line is level flight at the mean mass of the test points of one height and configuration.
    """
    model = _last_model(opened)
    if model is None:
        return {"lines": [], "model": None, "remarks": []}
    files = [opened.work / MATCH / f"{model}.{kind}" for kind in ("nc", "toml")]
    means = [means for _, means in _test_points(opened, query.get("names", ""))]
    points = pd.DataFrame(means, columns=[*_CONDITIONS, *_SETTINGS], dtype=float)

    def make() -> tuple[dict[str, xr.Dataset], list[str]]:
        db = opened.kept(("database",), files[:1], lambda: aerodb.open(files[0]))
        return aerodb.figures.one_g_lines(db, read_aircraft(files[1]), points)

    curves, remarks = opened.kept(("one g", points.to_json()), files, make, most=4)
    lines = []
    for curve in curves.values():
        line: dict[str, Any] = {
            "h": height_text(curve.attrs["h"]),
            "mass": round(curve.attrs["mass"], -1),
            "configuration": curve.attrs["configuration"],
        }
        # Level flight is not possible at a Mach number without an angle of attack.
        possible = curve.isel(mach=np.isfinite(curve["alpha"].values))
        for name in ("mach", "alpha", "V_cas"):
            line[name] = to_display_quantity(name, possible[name].values)[0]
        lines.append(line)
    return {"lines": lines, "model": model, "remarks": remarks}


def _last_model(opened: OpenProject) -> str | None:
    """Return the last model of the match whose database and aircraft exist."""
    for name in reversed(opened.project.own_models):
        files = [opened.work / MATCH / f"{name}.{kind}" for kind in ("nc", "toml")]
        if all(file.exists() for file in files):
            return name
    return None


def _test_points(opened: OpenProject, names: str) -> list[tuple[dict[str, Any], dict[str, float]]]:
    """Return every manoeuvre of the named records, with its mean conditions. [SI]"""
    points = []
    for name in filter(None, names.split(",")):
        _, marks = manoeuvres_of(opened, name)
        if opened.path_file(name).exists():
            leaves = [opened.path(name).states]
        else:
            leaves = [node.to_dataset() for node in opened.record(name).children.values()]
        for mark in marks.to_dict("records"):
            keys = ("manoeuvre", "control", "start", "end")
            manoeuvre = {"record": name, **{key: mark[key] for key in keys}}
            means = _mean_conditions(leaves, float(mark["start"]), float(mark["end"]))
            points.append((manoeuvre, means))
    return points


def _mean_conditions(leaves: list[xr.Dataset], start: float, end: float) -> dict[str, float]:
    """Return the means of the conditions in a span of time. [SI]"""
    means: dict[str, float] = {}
    for name in (*_CONDITIONS, *_SETTINGS):
        channel = _find_channel(leaves, name)
        if channel is None and name in _RECORDED_BY:
            channel = _find_channel(leaves, _RECORDED_BY[name])
        if channel is None:
            continue
        values = channel.sel(time=slice(start, end)).values
        if len(values) and np.isfinite(values).any():
            means[name] = float(np.nanmean(values))
    if "mach" not in means and {"V_cas", "h"} <= means.keys():
        impact_pressure = impact_pressure_at(means["V_cas"])
        means["mach"] = float(mach_number(impact_pressure, atmosphere(means["h"]).p_static))
    return means


def _find_channel(leaves: list[xr.Dataset], name: str) -> xr.DataArray | None:
    for leaf in leaves:
        if name in leaf:
            return leaf[name]
    return None


ROUTES = {
    ("GET", "/api/project"): show_project,
    ("GET", "/api/record"): show_record,
    ("GET", "/api/channels"): pack_channels,
    ("GET", "/api/check"): list_check_findings,
    ("GET", "/api/coverage"): list_test_points,
    ("GET", "/api/one_g"): list_one_g_lines,
    **CHANNEL_ROUTES,
}
"""Requests of the page of the records, by method and path.

A function has project, query and JSON body as arguments, and returns data, or bytes that are sent
unchanged.
"""
