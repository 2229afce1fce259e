"""Read a DATCOM listing: its cases, a printed table, and lift, drag and pitching moment as a
figure.

    python examples/read_a_listing.py [folder]

Writes ``listing.png`` and prints the cases. Needs matplotlib (``pip install
'aeromatch[figures]'``).
"""

from __future__ import annotations

import sys
from pathlib import Path

import datcom_io

DATA = Path(__file__).parents[1] / "data" / "c182" / "datcom"


def main(folder: Path) -> datcom_io.Listing:
    """Print the listing and draw its coefficients."""
    clean = datcom_io.read(DATA / "clean.out")
    print(clean)
    static = clean[0].block("static")
    print(static[["mach", "ALPHA", "CL", "CD", "CM"]].head(5).to_string(index=False))
    folder.mkdir(parents=True, exist_ok=True)
    clean.plot(["CL", "CD", "Cm"]).savefig(folder / "listing.png")
    return clean


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/listing"))
