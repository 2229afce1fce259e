"""Section on the validity envelope: a map per configuration, with the flights of the cases."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
import xarray as xr

from flightmech.air import atmosphere, impact_pressure_at, mach_number
from flightmech.envelope.envelope import make_envelope
from flightmech.envelope.maps import RegionMap, draw_maps, everywhere_text, region_maps
from flightmech.envelope.regions import EXTRAPOLATED, REGIONS
from flightmech.flown_states import CELL, FLOWN_STATES
from pom.judging.watched_channels import SLOWEST
from pom.report.submodels.section import Picture, Section, SectionTable
from pom.result import PomResult

NAME = "validity envelope"
_PER_PICTURE = 6  # maps
_WORDS = (
    "Maps of the regions of the validity envelope: {}. Lines are the flights of the cases of that "
    "configuration."
)
REMARK = (
    "Flown and between flown points are high and moderate confidence, a-priori is low confidence "
    "(14 CFR Part 60, Appendix A, Attachment 7). The region is the worst of the flown states and "
    "of the terms whose effect counts."
)


def final_maps(databases: Mapping[str, xr.DataTree]) -> tuple[RegionMap, ...]:
    """Return the maps of the last database that keeps its flown states; none without one."""
    for database in reversed(list(databases.values())):
        if database.attrs.get(FLOWN_STATES):
            return tuple(region_maps(make_envelope(database)))
    return ()


def envelope_section(maps: Sequence[RegionMap], results: Iterable[PomResult]) -> Section:
    """Return the section of maps, with the flights of results drawn in."""
    results = list(results)
    paths: dict[str, list[dict[str, np.ndarray]]] = {}
    for result in results:
        path = _flown_path(result)
        own = _map_of(result, maps)
        if path and own is not None:
            paths.setdefault(own.title, []).append(path)
    pictures = []
    for first in range(0, len(maps), _PER_PICTURE):
        chosen = maps[first : first + _PER_PICTURE]
        body, height = draw_maps(chosen, paths, f"envelope-{first}")
        titles = "; ".join(dict.fromkeys(own.title for own in chosen))
        pictures.append(Picture(body, height, _WORDS.format(titles)))
    return Section(
        NAME,
        (("aerodynamics", "sources of the nodes and flown states", ""),),
        (_share_table(maps), _left_table(results)),
        tuple(pictures),
        tuple(filter(None, (REMARK, everywhere_text(maps[0].everywhere if maps else ())))),
    )


def restored_map(own: RegionMap) -> RegionMap:
    """Return a map whose arrays and tuples came back from JSON as lists."""
    x, y = (np.asarray(edges, dtype=float) for edges in own.edges)
    regions, leaving = (np.asarray(item, np.uint8) for item in (own.regions, own.leaving))
    plane = str(own.plane[0]), str(own.plane[1])
    everywhere = tuple(map(str, own.everywhere))
    return replace(
        own, plane=plane, edges=(x, y), regions=regions, leaving=leaving, everywhere=everywhere
    )


def _flown_path(result: PomResult) -> dict[str, np.ndarray]:
    """Return alpha, beta and Mach number of the flight; empty if the result lacks one."""
    signals = result.signals
    if not {"alpha", "beta", "V_cas", "h"} <= set(signals):
        return {}
    flight = {name: signals[name].sel(run="flight").values for name in ("alpha", "beta", "h")}
    speed = signals["V_cas"].sel(run="flight").values
    # the static pressure of the standard atmosphere: a path in a map needs no more
    mach = mach_number(impact_pressure_at(speed), atmosphere(flight["h"]).p_static)
    kept = np.isfinite(flight["alpha"]) & np.isfinite(flight["beta"]) & np.isfinite(mach)
    # at rest flow angles have no meaning
    kept &= speed > SLOWEST
    if not kept.any():
        return {}
    return {"alpha": flight["alpha"][kept], "beta": flight["beta"][kept], "mach": mach[kept]}


def _map_of(result: PomResult, maps: Sequence[RegionMap]) -> RegionMap | None:
    """Return the map with the configuration at the start of a case; None if it has no map."""
    for own in maps:
        for name, value in own.configuration.items():
            if abs(result.conditions.get(name, 0.0) - value) > CELL[name]:
                break
        else:
            return own
    return None


def _share_table(maps: Sequence[RegionMap]) -> SectionTable:
    """Return the largest and smallest angle of attack and sideslip of the flown region."""
    rows = []
    for own in maps:
        if own.plane[1] != "beta":
            continue
        ends = []
        for k in range(2):
            flown = np.flatnonzero((np.asarray(own.regions) == 0).any(axis=1 - k))
            edges = np.degrees(np.asarray(own.edges[k]))
            ends.append(
                f"{edges[flown[0]]:.1f} ... {edges[flown[-1] + 1]:.1f}" if flown.size else "-"
            )
        rows.append((own.title, *ends))
    return SectionTable(
        "Flown region of each configuration",
        ("configuration", "angle of attack, deg", "sideslip, deg"),
        tuple(rows),
    )


def _left_table(results: Sequence[PomResult]) -> SectionTable:
    """Return the shares of time of the cases in the two outer regions."""
    rows = []
    for result in results:
        for run in result.runs:
            shares = {}
            own = result.verdict.loc[result.verdict["run"] == run, "remarks"]
            for remark in chain.from_iterable(own.tolist()):
                # a remark on the reach beyond a stall has no share of the time
                if remark.kind in ("low_confidence", "envelope_left") and "share" in remark.values:
                    shares[remark.kind] = f"{100.0 * remark.values['share']:.0f} %"
            if shares:
                cells = (shares.get("low_confidence", "-"), shares.get("envelope_left", "-"))
                rows.append((result.case.title or result.case.name, run, *cells))
    return SectionTable(
        "Cases beyond the flown region, share of the time",
        ("case", "model", REGIONS[2], REGIONS[EXTRAPOLATED]),
        tuple(rows),
    )
