"""Draw the figures of ``figures.md``: ``python docs/scripts/make_database_figures.py out/t37
--along path.nc``.

The folder holds ``datcom.nc`` and ``final.nc``, as ``./run demo`` leaves them; the path is a
reconstructed flight.  Needs the extra ``figures``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from PIL import Image

import aerodb

IMAGES = Path(__file__).parents[1] / "images"


def figures(folder: Path, along: Path, images: Path) -> list[Path]:
    """Write ``database-family.png`` and ``database-map.png``.

    Parameters
    ----------
    folder : Path
        Of ``datcom.nc`` and ``final.nc``.
    along : Path
        A reconstructed flight, whose samples are marked.
    images : Path
        Gets the figures.

    Returns
    -------
    list of Path
    """
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


def main() -> None:
    """Read the command line and draw."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("folder", type=Path, help="folder of datcom.nc and final.nc")
    parser.add_argument("--along", type=Path, required=True, help="reconstructed flight, netCDF")
    parser.add_argument("-o", "--output", type=Path, default=IMAGES, help="folder of the figures")
    options = parser.parse_args()
    for path in figures(options.folder, options.along, options.output):
        print(path)


if __name__ == "__main__":
    main()
