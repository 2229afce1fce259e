"""A thin-surface model as geometry file of AVL, with the signs of the product for its controls.

Source: M. Drela, H. Youngren, AVL User Primer: keywords SURFACE, SECTION, AIRFOIL, CONTROL, BODY.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerodb.estimators.vortex_lattice.geometry import HingedPart, ThinSurface, ThinSurfaceModel
from aerodb.estimators.vortex_lattice.sections import STATIONS
from flightmech.units import DEGREE

BODY_FILE = "body.dat"
# Gain and its sign on the mirrored side, for positive deflections of the product: trailing edge
# down, right aileron down, rudder trailing edge left.
_GAINS = {"delta_e": (1, 1), "delta_f": (1, 1), "delta_a": (1, -1), "delta_r": (-1, 1)}
_THICKNESS = 0.02  # of the profile around a mean line; AVL uses the mean line alone
_BODY_SOURCES = 40
_LEAST_PANELS = 2  # of an interval between two sections


@dataclass(frozen=True)
class PanelCounts:
    """Panels along the chord, along the half span of the wing, and of the other surfaces."""

    chord: int = 8
    wing: int = 26
    tail: int = 13

    def halved(self) -> PanelCounts:
        """Return half as many, for a check of convergence."""
        return PanelCounts(self.chord // 2, self.wing // 2, self.tail // 2)


def write_avl(model: ThinSurfaceModel, panels: PanelCounts, *, with_body: bool) -> dict[str, str]:
    """Return the files of a model by name, ``geometry.avl`` first. [m, deg]"""
    r = model.reference
    lines = [model.title, "0.0", "0 0 0.0"]
    lines.append(f"{r.S:.9g} {r.cbar:.9g} {r.b:.9g}")
    lines.append(f"{r.x:.9g} {r.y:.9g} {r.z:.9g}")
    lines.append("0.0")
    for surface in model.surfaces:
        lines += _write_surface(surface, panels)
    files = {}
    if with_body and model.body is not None:
        lines += ["BODY", "body", f"{_BODY_SOURCES} 1.0", "TRANSLATE"]
        lines += ["0.0 0.0 0.0", "BFIL", BODY_FILE]
        files[BODY_FILE] = _write_body(model.body)
    return {"geometry.avl": "\n".join(lines) + "\n", **files}


def _write_surface(surface: ThinSurface, panels: PanelCounts) -> list[str]:
    """Return the lines of one surface."""
    across = panels.wing if surface.name == "wing" else panels.tail
    # Cosine spacing along the chord.
    lines = ["SURFACE", surface.name.replace(" ", "_"), f"{panels.chord} 1.0"]
    if surface.is_mirrored:
        lines += ["YDUPLICATE", "0.0"]
    profile = _write_profile(surface.mean_line)
    # Panels of each interval by its share of the span. Equal spacing (3), in the last interval
    # closer at the tip (-2).
    shares = np.append(np.diff(surface.span) / surface.span[-1], 0.0)
    counts = np.maximum(np.rint(across * shares).astype(int), _LEAST_PANELS)
    last = len(shares) - 2
    for k, station in enumerate(surface.span):
        lines.append("SECTION")
        place = (surface.x[k], surface.y[k], surface.z[k], surface.chord[k])
        words = [f"{number:.9g}" for number in place]
        spacing = -2.0 if k == last else 3.0
        lines.append(
            " ".join([*words, f"{surface.twist[k] / DEGREE:.9g} {counts[k]} {spacing:.1f}"])
        )
        lines += profile
        for part in surface.controls:
            lines += _write_control(part, float(station), float(surface.span[-1]))
    return lines


def _write_control(part: HingedPart, station: float, half: float) -> list[str]:
    """Return the lines of a control at a station, none outside of it."""
    if not part.start - 1e-6 * half <= station <= part.end + 1e-6 * half:
        return []
    share = np.interp(station, (part.start, part.end), part.chords)
    gain, mirrored = _GAINS[part.control]
    # A hinge line of zeros is along the span.
    return ["CONTROL", f"{part.control} {gain} {1.0 - share:.9g} 0 0 0 {mirrored}"]


def _write_profile(mean_line: np.ndarray) -> list[str]:
    """Return a thin profile around a mean line, none for a flat one."""
    if not mean_line.any():
        return []
    x = STATIONS
    half = _THICKNESS * np.sqrt(x) * (1.0 - x)
    upper = np.column_stack([x[::-1], (mean_line + half)[::-1]])
    lower = np.column_stack([x[1:], (mean_line - half)[1:]])
    points = np.concatenate([upper, lower])
    return ["AIRFOIL", *(f"{a:.7f} {b:.7f}" for a, b in points)]


def _write_body(body: np.ndarray) -> str:
    """Return the outline of the body of revolution about its centre line."""
    x, centre, radius = body
    upper = np.column_stack([x[::-1], (centre + radius)[::-1]])
    lower = np.column_stack([x[1:], (centre - radius)[1:]])
    points = np.concatenate([upper, lower])
    return "\n".join(["body", *(f"{a:.7f} {b:.7f}" for a, b in points)]) + "\n"
