"""Draw the figure of ``check-cases.md``: ``python docs/scripts/figures/make_check_cases.py``.

Needs the records in ../shared/data/flight/nesc_checkcases and the extra ``figures``.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

ROOT = Path(__file__).parents[3]
IMAGES = Path(__file__).parents[2] / "images"
COLOURS = {"02": "#c08a00", "04": "#2a7a3b", "05": "#b03060"}
OURS = {"color": "black", "linewidth": 1.0, "label": "ours"}


def figure() -> Figure:
    """Return cases 11, 13.1, 13.3 and 15: ours over the published tools."""
    from nesc import records
    from nesc.flight import fly

    sheet = Figure(figsize=(11.0, 7.6), layout="constrained")
    panels = dict(zip(("11", "13p1", "13p3", "15"), sheet.subplots(2, 2).ravel(), strict=True))
    for case, axes in panels.items():
        own = records.as_recorded(fly(case))
        tools = {tool: records.published(case, tool) for tool in records.tools(case)}
        {"11": distances, "13p1": altitude_step, "13p3": heading_step, "15": ground_track}[case](
            axes, own, tools
        )
        axes.legend(frameon=False, fontsize=8)
    return sheet


def distances(axes: Axes, own: dict, tools: dict) -> None:
    """Heights of case 11 against ours."""
    for tool, record in tools.items():
        _, at_own, at_tool = np.intersect1d(own["time"], record["time"], return_indices=True)
        gap = np.abs(own["altitudeMsl_ft"][at_own] - record["altitudeMsl_ft"][at_tool])
        axes.semilogy(
            own["time"][at_own][1:],
            np.maximum(gap[1:], 1e-6),
            color=COLOURS[tool],
            label=f"tool {int(tool)} against ours",
        )
    axes.set(
        title="11: trimmed, controls fixed",
        xlabel="time [s]",
        ylabel="difference of height [ft]",
        ylim=(1e-6, 1e2),
    )


def altitude_step(axes: Axes, own: dict, tools: dict) -> None:
    """Pitch attitude of case 13.1."""
    over_time(axes, own, tools, "eulerAngle_deg_Pitch", 20.0)
    axes.set(
        title="13.1: 100 ft up at 5 s",
        xlabel="time [s]",
        ylabel="pitch attitude [deg]",
        xlim=(4.8, 7.0),
        ylim=(2.0, 8.5),
    )


def heading_step(axes: Axes, own: dict, tools: dict) -> None:
    """Bank of case 13.3."""
    over_time(axes, own, tools, "eulerAngle_deg_Roll", 30.0)
    axes.set(
        title="13.3: heading 15 deg to the right at 15 s",
        xlabel="time [s]",
        ylabel="bank [deg]",
        xlim=(14.5, 20.0),
    )


def over_time(axes: Axes, own: dict, tools: dict, column: str, until: float) -> None:
    """Draw one column of tools and ours."""
    for tool, record in tools.items():
        shown = record["time"] <= until
        axes.plot(
            record["time"][shown],
            record[column][shown],
            color=COLOURS[tool],
            linewidth=2.5,
            alpha=0.6,
            label=f"tool {int(tool)}",
        )
    axes.plot(own["time"], own[column], **OURS)


def ground_track(axes: Axes, own: dict, tools: dict) -> None:
    """The circle of case 15 seen from above the pole, 60 nautical miles a degree."""

    def place(record: dict) -> tuple[np.ndarray, np.ndarray]:
        radius, lon = 60.0 * (90.0 - record["latitude_deg"]), np.radians(record["longitude_deg"])
        return radius * np.cos(lon), radius * np.sin(lon)

    for tool, record in tools.items():
        axes.plot(
            *place(record), color=COLOURS[tool], linewidth=2.5, alpha=0.6, label=f"tool {int(tool)}"
        )
    axes.plot(*place(own), **OURS)
    axes.plot([0.0], [0.0], "k+")
    axes.set(
        title="15: around the North Pole",
        xlabel="towards 0 deg [nmi]",
        ylabel="towards 90 deg east [nmi]",
        aspect="equal",
    )


def main() -> None:
    """Read the command line and draw."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument(
        "-o", "--output", type=Path, default=IMAGES / "check-cases.png", help="the figure"
    )
    options = parser.parse_args()
    sys.path.insert(0, str(ROOT / "tests" / "published"))
    figure().savefig(options.output, dpi=110)
    Image.open(options.output).convert("RGB").quantize(64, dither=Image.Dither.NONE).save(
        options.output, optimize=True
    )
    print(options.output)


if __name__ == "__main__":
    main()
