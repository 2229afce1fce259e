"""Quantities that are formed of signals, and of which."""

from __future__ import annotations

from collections.abc import Container

SOURCES: dict[str, tuple[str, ...]] = {
    "time": (),
    "V_ground": ("vn", "ve"),
    "distance": ("vn", "ve"),
    "y_runway": ("vn", "ve"),
    "psi_dot": ("q", "r", "phi", "theta"),
    "F_rim": ("F_wheel",),
    "fuel_used": ("engine1.fuel_flow",),
}
"""Quantities that are formed of signals, and of which; a record or a model that holds the quantity itself is believed."""


def sources(channel: str) -> tuple[str, ...]:
    """Return the signals that a channel is formed of: itself, when it is a signal."""
    return SOURCES.get(channel, (channel,))


def output_of(channel: str, offered: Container[str]) -> str:
    """Return the output of a model that holds a channel: ``applied.delta_e`` holds ``delta_e``, which is an input."""
    applied = f"applied.{channel}"
    return applied if channel not in offered and applied in offered else channel
