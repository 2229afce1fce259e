"""Remarks about gaps of recordings: absent channels, and columns without a quantity."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import xarray as xr

# Alternative channels, their common name, and the consequence if all of them are absent.
_NEEDED = (
    (("delta_e",), "elevator", "no pitch manoeuvre can be found"),
    (("delta_a", "delta_a_left", "delta_a_right"), "aileron", "no roll manoeuvre can be found"),
    (("delta_r",), "rudder", "no yaw manoeuvre can be found"),
    (("V", "V_cas", "mach", "q_c"), "airspeed", "no coefficient can be formed"),
    (
        ("h_baro", "p_static", "h_gps"),
        "altitude or static pressure",
        "no air density can be formed",
    ),
    (
        ("alpha_vane",),
        "angle of attack",
        "it follows from the reconstruction alone, with a larger standard error",
    ),
)
# Columns that a remark names. The file names.toml lists all columns.
_MOST = 20


def channel_names(records: Iterable[xr.DataTree]) -> set[str]:
    """Return the names of the channels of all records."""
    names: set[str] = set()
    for record in records:
        for node in record.children.values():
            names.update(str(name) for name in node.data_vars)
    return names


def missing_channels(flights: Mapping[str, xr.DataTree]) -> list[str]:
    """Return a remark for each channel that no record has, with the consequence."""
    if not flights:
        return []
    channels = channel_names(flights.values())
    remarks = []
    for names, word, consequence in _NEEDED:
        if channels.isdisjoint(names):
            remarks.append(f"no {word} ({names[0]}) is recorded or recognised: {consequence}")
    return remarks


def listed_columns(record: xr.DataTree) -> list[str]:
    """Return the columns of a recording that its name map leaves out."""
    return [name for name in str(record.attrs.get("unmapped", "")).split(", ") if name]


def unknown_columns(columns: Sequence[str], has_map: bool) -> list[str]:
    """Return a remark that names the columns without a quantity, with the remedy."""
    if not columns:
        return []
    names = ", ".join(columns[:_MOST])
    if len(columns) > _MOST:
        names += f" and {len(columns) - _MOST} more"
    remedy = "add them to names.toml and run init again with --names names.toml --force"
    if has_map:
        remedy = "add them to the name map and run init again"
    return [f"columns without a quantity: {names}; where one is a channel, {remedy}"]
