"""Pages and files that the corpus lacks, of runs of the program itself."""

import numpy as np
import pytest

import datcom_io
from datcom_io.cells import ABSENT, NA, OK, SUSPECT

METRES = "DIM M\nDERIV DEG\n"
END = "NEXT CASE\n"


def cards(parts, *names):
    return "".join(parts[name] for name in names)


@pytest.mark.slow
def test_pages_over_ground_in_the_plot_file(run, parts):
    """CL, CD and CM of every height agree with the print; those from the second deflection on are
    flagged in both.
    """
    found = run(
        METRES + "PLOT\n",
        cards(parts, "flight", "body", "wing", "tail", "ground", "elevator"),
        "CASEID GROUND\n",
        END,
    )
    plot = datcom_io.exchange.read_plot(found.files["for013"])["case 1"]
    ground = plot["ground"].to_dataset().isel(configuration=-1, condition=0)
    assert dict(ground.sizes) == {"deflection": 3, "ground_height": 3, "alpha": 5}
    np.testing.assert_allclose(ground["ground_height"], [1.7, 3.0, 6.0], rtol=1e-4)
    static = found.listing[0].to_datatree()["static"].to_dataset().isel(condition=0)
    printed = static.sel(ground_height=[1.7, 3.0, 6.0]).transpose(
        "delta_e", "ground_height", "alpha"
    )
    for name, decimals in {"CL": 3, "CD": 3, "Cm": 4}.items():
        assert (printed[f"{name}_flag"].values[1:] == SUSPECT).all()
        assert (ground[f"{name}_flag"].values == printed[f"{name}_flag"].values).all()
        assert (np.abs(ground[name].values - printed[name].values) < 0.51 * 10.0**-decimals).all()
    assert plot["ground_records"].sizes["page"] == 9
    assert plot["static"].sizes["condition"] == 1


def test_cases_without_a_static_page_in_the_plot_file(run, parts):
    jet = f"PLOT\n{parts['transverse jet']}CASEID JET\n{END}"
    body = f"PLOT\n{parts['hypersonic body']}CASEID BODY\n{END}"
    found = run("DIM FT\n", jet, body, jet)
    plot = datcom_io.exchange.read_plot(found.files["for013"])
    assert [sorted(plot[name].children) for name in plot.children] == [
        ["records"],
        ["records", "static", "zero_lift"],
        ["records"],
    ]
    assert plot["case 1/records"]["FLC"].values[2] == 12.0  # MACH(1)
    fine = datcom_io.exchange.refine(found.listing[1].to_datatree(), plot["case 2"])
    assert fine["static"]["CL"].attrs["refined"].startswith("14 of 14")


def test_slopes_per_radian_are_refined(run, parts):
    """The file has slopes per degree: half a unit of its fifth digit is more than half a unit of
    the print per radian.
    """
    flight = (
        parts["flight"]
        .replace("NALPHA=5.0", "NALPHA=11.0")
        .replace(",12.0$", ",9.0,10.0,11.0,12.0,13.0,14.0,15.0$")
    )
    parts["flight"] = flight
    found = run(
        "DIM M\nDERIV RAD\nDAMP\nPLOT\n",
        cards(parts, "flight", "body", "wing", "tail"),
        "CASEID X\n",
        END,
    )
    fine = datcom_io.exchange.refine(
        found.listing[0].to_datatree(),
        datcom_io.exchange.read_plot(found.files["for013"])["case 1"],
    )
    assert fine["static"]["CL_alpha"].attrs["refined"].startswith("11 of 11")


def test_ailerons_over_ground(run, parts):
    """The heights come once for each deflection; the first page has the place, all are in the
    cells.
    """
    found = run(
        METRES,
        cards(parts, "flight", "body", "wing", "ground", "ailerons"),
        "CASEID GROUND AILERONS\n",
        END,
    )
    case = found.listing[0]
    assert len(list(case.tables("static"))) == 10
    tree = case.to_datatree()
    static = tree["static"].to_dataset()
    assert dict(static.sizes) == {"condition": 1, "ground_height": 4, "alpha": 5}
    first = next(table for page, table in case.tables("static") if np.isfinite(page.ground_height))
    assert static["CL"].sel(ground_height=1.7).values[0].tolist() == first.values[:, 2].tolist()
    assert not (static["CL_flag"] == ABSENT).any()
    assert tree["asyflp"].sizes["delta_pair"] == 3


def test_power_on_cells_without_a_value(run, parts):
    """CM is NA from 18 deg on without power; with it the increment stands there."""
    parts["flight"] = (
        parts["flight"].replace("NALPHA=5.0", "NALPHA=7.0").replace(",12.0$", ",16.0,18.0,20.0$")
    )
    clean = run(
        METRES, cards(parts, "flight", "body", "wing", "tail"), "CASEID CLEAN\n", END, name="clean"
    ).listing[0]
    power = run(
        METRES,
        cards(parts, "flight", "body", "wing", "tail", "jet power"),
        "CASEID POWER\n",
        END,
        name="power",
    ).listing[0]
    without, with_power = (case.to_datatree()["static"].to_dataset() for case in (clean, power))
    missing = without["Cm_flag"].values[0] == NA
    assert missing.sum() == 2
    for name in ("Cm", "xcp"):
        assert (with_power[f"{name}_flag"].values[0] == np.where(missing, SUSPECT, OK)).all()
    assert (
        np.abs(with_power["Cm"].values[0][missing]) < 0.1
    ).all()  # -0.19 at 16 deg without power
    assert (with_power["CL_flag"].values == OK).all()


def test_a_jet_page_without_angles(run, parts):
    found = run("DIM FT\n", parts["transverse jet"], "CASEID JET\n", END)
    assert [page.kind for page in found.listing[0].pages] == ["special"]
    assert found.listing[0].to_datatree()["jet"].sizes == {"condition": 1, "time": 4}
    deck = datcom_io.read_deck(f"DIM FT\n{parts['transverse jet']}CASEID JET\n{END}".split("\n"))
    assert not [finding for finding in datcom_io.check_deck(deck) if finding.severity == "error"]


def test_a_boattail(run, parts):
    """The warning of the dynamic page goes on over two lines."""
    found = run("DIM FT\nDAMP\n", parts["hypersonic body"], "CASEID BOATTAIL\n", END)
    assert found.listing.unread == []
    texts = [message.text for message in found.listing[0].messages]
    assert any(
        text.endswith("NOT VALID FOR BODIES WITH BOATTAILS BOATTAIL EFFECTS IGNORED]")
        for text in texts
    )


@pytest.mark.nightly
@pytest.mark.parametrize("card", ["DUMP ALL", "DUMP CASE", "NAMELIST", "PRINT EXTRAP"])
def test_additional_print_changes_no_table(run, parts, card):
    aircraft = cards(parts, "flight", "body", "wing", "tail", "elevator")
    plain, more = (
        run(METRES, head, aircraft, "CASEID X\n", END, name=name).listing
        for name, head in {"plain": "", "more": f"{card}\n"}.items()
    )
    assert more.unread == []
    trees = [listing[0].to_datatree() for listing in (plain, more)]
    assert trees[0].children.keys() == trees[1].children.keys()
    for name, leaf in trees[0].children.items():
        for variable in leaf.data_vars:
            np.testing.assert_array_equal(leaf[variable], trees[1][name][variable])
