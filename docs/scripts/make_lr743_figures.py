"""Draw the figures of ``lr743-figures.md``: ``python docs/scripts/make_lr743_figures.py out/t37``.

The folder is one that ``aeromatch demo`` wrote.  Needs the extra ``figures``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from PIL import Image

import aerodb
import flightmech

IMAGES = Path(__file__).parents[1] / "images" / "lr743"
WIDTH = 1000  # of a picture [px]


def figures(folder: Path, images: Path) -> list[str]:
    """Write the set as small pictures; return what could not be drawn, and why."""
    databases = {name: aerodb.open(folder / f"{name}.nc") for name in ("datcom", "final")}
    aircraft = {name: flightmech.read_aircraft(folder / f"{name}.toml") for name in databases}
    flown = aerodb.figures.read_flown(folder / "flown.nc")
    sources = "datcom.nc, final.nc, flown.nc of aeromatch demo"
    made = aerodb.figures.write_lr743(
        databases, images, "png", aircraft=aircraft, flown=flown, sources=sources
    )
    for file in images.glob("*.png"):
        picture = Image.open(file).convert("RGB")
        picture = picture.resize(
            (WIDTH, round(picture.height * WIDTH / picture.width)), Image.Resampling.LANCZOS
        )
        picture.quantize(64, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
            file, optimize=True
        )
    for table in images.glob("*.csv"):
        table.unlink()  # the page prints them
    return [f"{one.number} {one.title}: {one.missing}" for one in made if one.missing]


def main() -> None:
    """Read the command line and draw."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("folder", type=Path, help="folder that aeromatch demo wrote")
    parser.add_argument(
        "-o", "--output", type=Path, default=IMAGES, help="new or empty folder of the figures"
    )
    options = parser.parse_args()
    print("\n".join(figures(options.folder, options.output)))


if __name__ == "__main__":
    main()
