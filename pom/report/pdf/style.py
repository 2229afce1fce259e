"""Styles of drawings for paper, and the drawing as a whole.

Lengths are the units of `flightmech.support.figures`, 720 of them across the column (182 mm on A4),
so that text of 10 units is 7.2 pt.  Every colour that must be recognisable in grey also has a
pattern or a dash.
"""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flightmech.support.figures import WIDTH
from pom.report.presentation.quantities import QuantityLabel

# Margins at the sides, and height of the heading of a panel.
LEFT, RIGHT, HEAD = 50.0, 6.0, 15.0
# The font has no wider space, and a glyph of another font changes the font of its whole line.
SPACE = "\N{NO-BREAK SPACE}"

FAMILY = "Source Sans Pro"
# Fill and edge of the tolerance band, exits from it, grid, quiet lines.
BAND, EDGE, EXIT, GRID, QUIET = "#dbe9f6", "#7ea6cc", "#d55e00", "#dedede", "#444444"
# Colour, dash and width by class: the line code of LR-743 Figs. 18 to 21, and two spare styles.
LINES = {
    "run-0": ("#000000", "", 1.7),
    "run-1": ("#5e5e5e", "1.6 2.4", 1.8),
    "run-2": ("#8a5a00", "7 3", 1.4),
    "run-3": ("#0072b2", "9 2.6 1.8 2.6", 1.4),
    "run-4": ("#7a3e9d", "13 4", 1.4),
    "run-5": ("#00664b", "9 2.6 1.8 2.6 1.8 2.6", 1.4),
}

_STYLE = f"""
text{{font-family:"{FAMILY}";font-size:10.6px;fill:#000}}
.tick,.tick text{{font-size:10.2px;fill:#222}}
.caption{{font-size:10.6px;fill:#222}}
.title{{font-size:10.6px;font-weight:600}}
.symbol{{font-size:11.5px;font-style:italic}}
.sub{{font-size:10px}}
.halo{{paint-order:stroke;stroke:#fff;stroke-width:3;stroke-linejoin:round;fill:#000}}
.grid{{fill:none;stroke:{GRID};stroke-width:.5}}
.frame{{fill:none;stroke:{QUIET};stroke-width:.7}}
.window{{stroke:{QUIET};stroke-width:.8;stroke-dasharray:2 2}}
.event{{stroke:{QUIET};stroke-width:.7}}
.band{{fill:{BAND};stroke:{EDGE};stroke-width:.6}}
.exit{{fill:url(#hatching)}}
.trace{{fill:none;stroke-linejoin:round}}
.fan{{stroke:none;fill-opacity:.24}}
.hair{{fill:none;stroke:#000;stroke-width:.45;stroke-linejoin:round}}
.envelope{{fill:none;stroke:{QUIET};stroke-width:.6;stroke-dasharray:3 2}}
.lane{{stroke-width:2.4}}
.error{{stroke:none;fill-opacity:.18}}
.node{{fill:none;stroke-width:2.4;stroke-linecap:round}}
.node.hollow{{stroke:#fff;stroke-width:1.2}}
.rug{{stroke:{QUIET};stroke-width:.6}}
.test-point{{stroke:#0072b2;stroke-width:2.2;stroke-linecap:round}}
.tickmark{{stroke:{EXIT};stroke-width:1.4}}
.arrow{{stroke:none}}
.bar{{fill:#9db8d2;stroke:#1f4e79;stroke-width:.7}}
.rise{{fill:url(#hatching);stroke:{EXIT};stroke-width:.7}}
.total{{fill:#4d4d4d}}
.joint{{stroke:{QUIET};stroke-width:.6;stroke-dasharray:2 2}}
"""
_HATCHING = (
    '<pattern id="hatching" width="5" height="5" patternUnits="userSpaceOnUse" '
    'patternTransform="rotate(45)">'
    f'<rect width="5" height="5" fill="{EXIT}" fill-opacity=".2"/>'
    f'<line x1="0" y1="0" x2="0" y2="5" stroke="{EXIT}" stroke-width="1.3"/></pattern>'
)


def style_definitions() -> str:
    """Return styles and patterns, for the head of every drawing."""
    rules = ""
    for name, (colour, dash, width) in LINES.items():
        dashes = f";stroke-dasharray:{dash}" if dash else ""
        rules += (
            f".{name}{{stroke:{colour}}}"
            f".trace.{name}{{stroke-width:{width}{dashes}}}"
            f".arrow.{name},.{name}-area{{fill:{colour}}}"
        )
    return f"<style>{_STYLE}{rules}</style><defs>{_HATCHING}</defs>"


@dataclass(frozen=True)
class Drawing:
    """An SVG with its height in units and its alternative text."""

    svg: str
    height: float
    words: str


def svg_drawing(height: float, body: str) -> str:
    """Return a complete drawing with the styles of the paper."""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:.0f} '
        f'{height:.1f}">{style_definitions()}{body}</svg>'
    )


def save_drawing(folder: Path, name: str, drawing: Drawing) -> dict[str, Any]:
    """Write a drawing, and return its entry in the data of the document."""
    (folder / name).write_text(drawing.svg, encoding="utf-8")
    return {"file": name, "height": drawing.height, "alt": drawing.words}


def label_text(label: QuantityLabel) -> str:
    """Return the words of a quantity with its unit."""
    unit = f", {label.unit}" if label.unit else ""
    return f"{label.words or label.name}{unit}"


def title_pieces(label: QuantityLabel) -> list[tuple[str, str]]:
    """Return symbol, words and unit of a quantity as text pieces (text, class)."""
    pieces = []
    # Drawings have no glyph for a dot over a Greek letter; the words stand for such a symbol.
    has_mark = any(map(unicodedata.combining, label.base))
    if not label.is_word and not has_mark:
        pieces.append((label.base, "symbol"))
        if label.sub:
            pieces.append((label.sub, "sub"))
        pieces.append((2 * SPACE, ""))
    pieces.append((label_text(label), "title"))
    return pieces
