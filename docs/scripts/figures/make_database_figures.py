"""Draw the figures of ``figures.md`` and of ``lr743-figures.md``: ``python
docs/scripts/figures/make_database_figures.py out/t37 --along path.nc``.

The folder is one that ``aeromatch demo`` wrote; the path is a reconstructed flight.  Needs the
extra ``figures``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from PIL import Image

import aerodb
import flightmech

IMAGES = Path(__file__).parents[2] / "images"
WIDTH = 1000  # of a picture of the set of LR-743 [px]


def draw_comparison(folder: Path, along: Path, images: Path) -> list[Path]:
    """Write ``database-family.png`` and ``database-map.png``, with the samples of a flight."""
    databases = {name: aerodb.open(folder / f"{name}.nc") for name in ("datcom", "final")}
    flown, _ = aerodb.comparison.read_conditions(along, *databases.values())
    made = {
        "database-family.png": aerodb.figures.plot_comparison(databases, "CL/basic", support=flown),
        "database-map.png": aerodb.figures.plot_difference(databases, "CL/basic", support=flown),
    }
    images.mkdir(parents=True, exist_ok=True)
    for name, figure in made.items():
        aerodb.figures.save_figure(figure, images / name)
        Image.open(images / name).convert("RGB").quantize(64, dither=Image.Dither.NONE).save(
            images / name, optimize=True
        )
    return [images / name for name in made]


def draw_lr743(folder: Path, images: Path) -> list[str]:
    """Write the set as small pictures into a new or empty folder; return what could not be drawn,
    and why.
    """
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
        table.unlink()  # no page shows them
    return [f"{one.number} {one.title}: {one.missing}" for one in made if one.missing]


def main() -> None:
    """Read the command line and draw."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("folder", type=Path, help="folder that aeromatch demo wrote")
    parser.add_argument("--along", type=Path, required=True, help="reconstructed flight, netCDF")
    parser.add_argument("-o", "--output", type=Path, default=IMAGES, help="folder of the figures")
    options = parser.parse_args()
    for path in draw_comparison(options.folder, options.along, options.output):
        print(path)
    print("\n".join(draw_lr743(options.folder, options.output / "lr743")))


if __name__ == "__main__":
    main()
