"""How the report looks on paper: colours, dashes and text of its drawings.

Contrast measured on white and on the band; every line differs in its dash too, exits are hatched, so that a grey print shows all.
"""

from __future__ import annotations

FAMILY = "Source Sans Pro"
BAND, EDGE, EXIT, GRID, QUIET = "#dbe9f6", "#7ea6cc", "#d55e00", "#dedede", "#444444"
# class -> colour, dash, width: the line code of LR-743 Figs. 18 to 21, then two spare styles
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
    '<pattern id="hatching" width="5" height="5" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">'
    f'<rect width="5" height="5" fill="{EXIT}" fill-opacity=".2"/>'
    f'<line x1="0" y1="0" x2="0" y2="5" stroke="{EXIT}" stroke-width="1.3"/></pattern>'
)


def defs() -> str:
    """Return styles and patterns, to stand at the head of every drawing."""
    lines = ""
    for name, (colour, dash, width) in LINES.items():
        dashes = f";stroke-dasharray:{dash}" if dash else ""
        lines += f".{name}{{stroke:{colour}}}.trace.{name}{{stroke-width:{width}{dashes}}}.arrow.{name},.{name}-area{{fill:{colour}}}"
    return f"<style>{_STYLE}{lines}</style><defs>{_HATCHING}</defs>"
