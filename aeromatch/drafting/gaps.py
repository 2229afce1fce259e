"""What the records lack: channels that identification needs, and columns that no quantity was found
for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import xarray as xr

# channels of which one is needed, what they are called, and what is impossible without them
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
_MOST = 20  # columns that a remark names; names.toml lists all


def missing_channels(flights: Mapping[str, xr.DataTree]) -> list[str]:
    """Return a remark for each channel that no record has, with what is impossible without it."""
    shown = {
        str(name)
        for record in flights.values()
        for node in record.children.values()
        for name in node.data_vars
    }
    absent = [(names[0], word, loss) for names, word, loss in _NEEDED if not shown & set(names)]
    return (
        [f"no {word} ({name}) is recorded or recognised: {loss}" for name, word, loss in absent]
        if flights
        else []
    )


def listed_columns(record: xr.DataTree) -> list[str]:
    """Return the columns of a recording that its name map leaves out."""
    return [name for name in str(record.attrs.get("unmapped", "")).split(", ") if name]


def unknown_columns(columns: Sequence[str], has_map: bool) -> list[str]:
    """Return the remark that names the columns without a quantity, and how to give them one."""
    if not columns:
        return []
    more = f" and {len(columns) - _MOST} more" if len(columns) > _MOST else ""
    remedy = (
        "add them to the name map and run init again"
        if has_map
        else "add them to names.toml and run init again with --names names.toml --force"
    )
    return [
        f"columns without a quantity: {', '.join(columns[:_MOST])}{more}; where one is a "
        f"channel, {remedy}"
    ]
