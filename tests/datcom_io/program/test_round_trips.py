"""The aircraft in four units, in both layouts of the print, split into runs, and its slopes against
its coefficients.
"""

import re

import numpy as np
import pytest

import aerodb
import datcom_io
from flightmech.aircraft.aircraft import Aircraft
from flightmech.units import DEGREE

END = "NEXT CASE\n"
LENGTHS = {
    "FLTCON": ("ALT",),
    "OPTINS": ("CBARR", "BLREF"),
    "SYNTHS": ("XCG", "ZCG", "XW", "ZW", "XH", "ZH", "XV", "ZV"),
    "BODY": ("X", "R", "BLN", "BLA"),
    "WGPLNF": ("CHRDR", "CHRDTP", "SSPN", "SSPNE"),
    "HTPLNF": ("CHRDR", "CHRDTP", "SSPN", "SSPNE"),
    "VTPLNF": ("CHRDR", "CHRDTP", "SSPN", "SSPNE"),
}


def in_units(parts, dim, per_metre):
    """Return the clean aircraft with every length in another unit."""
    deck = datcom_io.read_deck(
        [
            *"".join(parts[name] for name in ("flight", "body", "wing", "tail")).split("\n"),
            "CASEID UNITS",
            "NEXT CASE",
        ]
    )[0]
    lines = [f"DIM {dim}"]
    for name, group in deck.namelists.items():
        for variable, values in group.items():
            factor = (
                per_metre
                if variable in LENGTHS[name]
                else per_metre**2
                if variable == "SREF"
                else 1.0
            )
            texts = [
                ".TRUE." if variable == "VERTUP" else repr(round(value * factor, 7))
                for value in values
            ]
            lines += (
                [f" ${name} {variable}({k})={text}$" for k, text in enumerate(texts, 1)]
                if len(texts) > 1
                else [f" ${name} {variable}={texts[0]}$"]
            )
    return "\n".join(
        [
            *lines,
            *(f"NACA {surface} {section}" for surface, section in deck.sections.items()),
            "CASEID UNITS",
            "NEXT CASE",
            "",
        ]
    )


@pytest.mark.slow
def test_four_units(run, parts):
    """The same aircraft in SI whatever the unit; a last digit of the print may turn over."""
    trees = {
        dim: run(in_units(parts, dim, k), name=dim).listing[0].to_datatree()
        for dim, k in (("M", 1), ("CM", 100), ("FT", 1 / 0.3048), ("IN", 1 / 0.0254))
    }
    metres = trees.pop("M")
    for dim, tree in trees.items():
        for name in ("S", "cbar", "b", "x_cg", "z_cg"):
            assert tree.attrs[name] == pytest.approx(metres.attrs[name], rel=1e-5), dim
        for name, unit in {"CL": 1e-3, "CD": 1e-3, "Cm": 1e-4, "CA": 1e-3}.items():
            np.testing.assert_allclose(
                tree["static"][name],
                metres["static"][name],
                rtol=0.0,
                atol=1.01 * unit,
                err_msg=f"{name} {dim}",
            )
        np.testing.assert_allclose(tree["static"]["V"], metres["static"]["V"], rtol=2e-3)


def test_both_layouts_of_the_print(run, parts):
    """With and without progress lines between the tables, and without the column of the carriage
    control.
    """
    found = run(
        "DIM M\nDAMP\nPART\n",
        *(parts[name] for name in ("flight", "body", "wing", "tail", "elevator")),
        "CASEID LAYOUT\n",
        END,
    )
    lines = found.files["out"].read_text("latin-1").split("\n")
    progress = re.compile(r" *(Return to main program|Preparing to start)")
    plain = [line for line in lines if not progress.match(line)]
    assert len(plain) < len(lines) - 5
    filtered = [("\f" if line.startswith("1") else "") + line[1:] for line in plain]
    cells = [datcom_io.read(text).cells().drop(columns="line") for text in (lines, plain, filtered)]
    assert cells[0].equals(cells[1])
    assert cells[0].equals(cells[2])


@pytest.mark.nightly
def test_split_run_and_build(run, parts):
    """A study split into runs; the database made of them returns the printed numbers."""
    study = datcom_io.read_deck(
        [
            "DIM M",
            *"".join(
                parts[name] for name in ("flight", "body", "wing", "tail", "elevator", "ailerons")
            ).split("\n"),
            "DAMP",
            "CASEID STUDY",
            "NEXT CASE",
        ]
    )
    runs = datcom_io.split_deck(study)
    listings = {
        name: run(datcom_io.decks.deck_file.deck_text(deck), name=re.sub(r"\W", "_", name)).listing
        for name, deck in runs.items()
    }
    clean = listings["clean"]
    aircraft = Aircraft(
        name="study",
        mass=3500.0,
        Ixx=9e3,
        Iyy=12e3,
        Izz=20e3,
        S=24.2,
        cbar=2.022,
        b=13.36,
        reference=(-6.3, 0.0, 0.15),
        x_ref_mac=0.298,
    )
    elevator = [listing for name, listing in listings.items() if name.startswith("elevator")]
    assert len(elevator) == 3
    db = aerodb.from_datcom(
        aircraft, clean=clean, elevator=elevator, aileron=listings["aileron"], altitude=0.0
    )
    static = clean[0].to_datatree()["static"].to_dataset().isel(condition=0)
    at = {"alpha": static["alpha"].values, "mach": 0.15, "qhat": 0.0, "alphadothat": 0.0}
    for name in ("CL", "CD", "Cm"):
        np.testing.assert_allclose(
            aerodb.evaluate(db, name, delta_e=0.0, **at),
            static[name],
            rtol=0.0,
            atol=1e-9,
            err_msg=name,
        )
    tables = [
        listing[0].to_datatree()["symflp"].to_dataset().isel(condition=0, delta=0)
        for listing in elevator
    ]
    (zero,) = (table for table in tables if float(table["delta"]) == 0.0)
    for table in tables:
        for name in ("CL", "Cm"):
            got = aerodb.evaluate(db, name, delta_e=float(table["delta"]), **at) - static[name]
            wanted = float(
                table[f"d{name}"] - zero[f"d{name}"]
            )  # the program takes a deflection of zero as 0.01 deg
            np.testing.assert_allclose(got, wanted, rtol=0.0, atol=1e-9, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("deriv", ["DEG", "RAD"])
def test_slopes_are_those_of_the_coefficients(run, parts, deriv):
    """CLA and CMA of the tree [1/rad] against central differences of the printed CL and CM, one
    degree apart, attached flow.

    Half a unit of the print on both sides is 0.029 per radian in CLA, 0.0029 in CMA; another half
    is left for the program's own three-point slopes.  The database made of the listing has the same
    slopes between its nodes.
    """
    alphas = np.arange(-4.0, 9.0)
    text = ",".join(f"{alpha:.1f}" for alpha in alphas)
    flight = (
        parts["flight"]
        .replace("NALPHA=5.0", f"NALPHA={len(alphas)}.0")
        .replace("-4.0,0.0,4.0,8.0,12.0", text.replace(",2.0", ",\n   2.0", 1))
    )
    listing = run(
        f"DIM M\nDERIV {deriv}\nDAMP\n",
        flight,
        *(parts[name] for name in ("body", "wing", "tail")),
        "CASEID SLOPES\n",
        END,
    ).listing
    static = listing[0].to_datatree()["static"].to_dataset().isel(condition=0)
    for name, slope, unit in (("CL", "CL_alpha", 1e-3), ("Cm", "Cm_alpha", 1e-4)):
        differences = (static[name].values[2:] - static[name].values[:-2]) / (2.0 * DEGREE)
        np.testing.assert_allclose(
            static[slope].values[1:-1],
            differences,
            rtol=0.0,
            atol=1.5 * unit / (2.0 * DEGREE),
            err_msg=slope,
        )
    aircraft = Aircraft(
        name="slopes",
        mass=3500.0,
        Ixx=9e3,
        Iyy=12e3,
        Izz=20e3,
        S=24.2,
        cbar=2.022,
        b=13.36,
        reference=(-6.3, 0.0, 0.15),
        x_ref_mac=0.298,
    )
    db = aerodb.from_datcom(aircraft, clean=listing, altitude=0.0)
    for name, slope, unit in (("CL", "CL_alpha", 1e-3), ("Cm", "Cm_alpha", 1e-4)):
        ends = [
            aerodb.evaluate(
                db, name, alpha=(alphas[1:-1] + step) * DEGREE, mach=0.15, qhat=0.0, alphadothat=0.0
            )
            for step in (-1.0, 1.0)
        ]
        differences = (ends[1] - ends[0]) / (2.0 * DEGREE)
        np.testing.assert_allclose(
            static[slope].values[1:-1],
            differences,
            rtol=0.0,
            atol=1.5 * unit / (2.0 * DEGREE),
            err_msg=f"database {slope}",
        )
