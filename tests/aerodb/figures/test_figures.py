"""Figures by what their axes hold, and their files by their bytes."""

import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

import aerodb
from aerodb.figures.family_panels import spread_apart
from flightmech import terms
from flightmech.errors import SchemaError
from flightmech.units import DEGREE


@pytest.fixture
def final(small):
    """The small database after a flight: CL/basic 0.1 lower at alpha 16 deg, which the flight
    reached at Mach 0.4.
    """
    leaf = aerodb.terms(small)["CL/basic"].copy(deep=True)
    leaf["value"][:, -1] -= 0.1
    leaf["source"][1, -1] = 1
    leaf["stderr"][1, -1] = 0.01
    return aerodb.replace_terms(small, {"CL/basic": leaf})


@pytest.fixture
def both(small, final):
    return {"datcom": small, "final": final}


def panel(figure, title):
    """Return the panel of a member and the strip below it."""
    found = [i for i, axes in enumerate(figure.axes) if axes.get_title(loc="left") == title]
    assert len(found) == 1
    return figure.axes[found[0]], figure.axes[found[0] + 1]


def line(axes, label):
    return next(item for item in axes.lines if item.get_label() == label)


def texts(figure):
    return "\n".join(item.get_text() for item in figure.texts)


def test_families_side_by_side_in_equal_scales(both):
    figure = aerodb.figures.plot_comparison(both, "CL/basic")
    datcom, final = figure.axes[:2]
    assert (datcom.get_title(loc="left"), final.get_title(loc="left")) == ("datcom", "final")
    assert datcom.get_ylim() == final.get_ylim()
    assert datcom.get_xlim() == final.get_xlim()
    fast = line(final, "final $M$ = 0.4")
    np.testing.assert_allclose(np.interp(8.0, *fast.get_data()), 0.2 + 5.4 * 8 * DEGREE)
    assert (line(datcom, "datcom $M$ = 0.2").get_linestyle(), fast.get_linestyle()) == (
        "--",
        "-",
    )  # dotted is a dash pattern
    assert [label.get_text() for label in final.texts if label.get_text() in ("0.2", "0.4")] == [
        "0.2",
        "0.4",
    ]
    assert datcom.get_xlabel() == r"$\alpha$ [deg]"
    assert datcom.get_ylabel() == "$C_{L}$ [1]"


def test_a_member_has_all_databases_bands_nodes_and_the_difference(both):
    main, strip = panel(aerodb.figures.plot_comparison(both, "CL/basic"), "$M$ = 0.4")
    np.testing.assert_allclose(
        np.interp(16.0, *line(main, "datcom").get_data()), 0.2 + 5.4 * 16 * DEGREE
    )
    np.testing.assert_allclose(
        np.interp(16.0, *line(main, "final").get_data()), 0.1 + 5.4 * 16 * DEGREE
    )
    np.testing.assert_allclose(line(main, "final nodes 0").get_xdata(), [-8.0, 0.0, 8.0])
    np.testing.assert_allclose(line(main, "final nodes 1").get_xdata(), [16.0])
    assert line(main, "final nodes 0").get_markerfacecolor() == "white"
    assert line(main, "final nodes 1").get_markerfacecolor() != "white"
    band = (
        next(item for item in main.collections if item.get_label() == "datcom error")
        .get_paths()[0]
        .vertices
    )
    edges = band[np.isclose(band[:, 0], 8.0), 1]
    np.testing.assert_allclose(
        [edges.min(), edges.max()], 0.2 + 5.4 * 8 * DEGREE + np.array([-0.05, 0.05])
    )
    x, difference = line(strip, "final").get_data()
    np.testing.assert_allclose(
        np.interp([8.0, 12.0, 16.0], x, difference), [0.0, -0.05, -0.1], atol=1e-15
    )


def test_flight_samples_are_ticks_in_their_panel(both):
    flown = {"alpha": np.radians([2.0, 4.0, 9.0]), "mach": np.array([0.21, 0.2, 0.39])}
    figure = aerodb.figures.plot_comparison(both, "CL/basic", support=flown)
    for title, places in (("$M$ = 0.2", [2.0, 4.0]), ("$M$ = 0.4", [9.0])):
        main, _ = panel(figure, title)
        ticks = next(item for item in main.collections if item.get_label() == "flight sample")
        np.testing.assert_allclose(
            [segment[0, 0] for segment in ticks.get_segments()], places, atol=0.05
        )
    assert "flight sample" in [text.get_text() for text in figure.legends[0].get_texts()]


@pytest.mark.slow
def test_the_foot_states_what_numbers_refer_to(both, small):
    foot = " ".join(texts(aerodb.figures.plot_comparison(both, "CL/basic")).split("\n"))
    assert (
        "S = 16.9 m², cbar = 1.667 m, b = 10.31 m; moments about (−3, 0, 0) m from the "
        "drawing datum" in foot
    )
    assert "forces in stability axes, moments and rates in body axes" in foot
    assert "CL positive up" in foot
    assert "Lower strips: difference to datcom" in foot
    larger = small.copy()
    larger.attrs["S"] = 20.0
    foot = texts(aerodb.figures.plot_comparison({"datcom": small, "larger": larger}, "CL/basic"))
    assert "Reference of datcom: S = 16.9 m²" in foot
    assert "Reference of larger: S = 20 m²" in foot


def test_a_term_of_one_database(small):
    figure = aerodb.figures.plot_term(small, "CL/qhat")
    (axes,) = figure.axes  # one curve over Mach number: no family, no strip
    np.testing.assert_allclose(line(axes, "database").get_ydata()[[0, -1]], [8.0, 8.4])
    assert axes.get_ylabel() == r"$C_{L\,\hat{q}}$ [1]"
    assert "reduced pitch rate, q cbar/(2 V)" in texts(figure)
    assert "test: CL/qhat, lift coefficient: pitch rate" in texts(figure)


def test_a_database_that_lacks_the_term_is_named(small, final):
    gear = aerodb.terms(small)["CL/flap"]
    figure = aerodb.figures.plot_comparison(
        {"datcom": small, "final": aerodb.replace_terms(final, {"CD/flap": gear})}, "CD/flap"
    )
    assert "Without this term: datcom." in texts(figure)


def test_a_coefficient_is_drawn_at_stated_conditions(both):
    figure = aerodb.figures.plot_comparison(both, "CL", at={"delta_f": 20 * DEGREE})
    main, _ = panel(figure, "$M$ = 0.2")
    np.testing.assert_allclose(np.interp(0.0, *line(main, "final").get_data()), 0.4)
    assert r"at $\delta_{f}$ = 20 deg, $\hat{q}$ = 0" in texts(figure)


def test_map_of_the_difference(both):
    figure = aerodb.figures.plot_difference(both, "CL/basic")
    plain, in_errors = figure.axes
    assert plain.get_title(loc="left") == "difference [1]"
    assert in_errors.get_title(loc="left") == "difference in standard errors of datcom"
    # the difference falls from 0 at 8 deg to -0.1 at 16 deg: the line of -0.05 lies half way
    contours = next(item for item in plain.collections if item.get_label() == "difference [1]")
    level = int(np.flatnonzero(np.isclose(contours.levels, -0.05))[0])
    np.testing.assert_allclose(contours.get_paths()[level].vertices[:, 0], 12.0, atol=1e-9)
    np.testing.assert_allclose(plain.get_xlim(), [-8.0, 16.0])
    same = aerodb.figures.plot_difference({"a": both["datcom"], "b": both["datcom"]}, "CL/basic")
    assert [text.get_text() for text in same.axes[0].texts] == ["no difference"]


@pytest.mark.nightly
@pytest.mark.parametrize(
    "kind", ["svg", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("png", "pdf"))]
)
def test_equal_figures_give_equal_bytes(both, tmp_path, kind):
    for name in ("one", "two"):
        aerodb.figures.save_figure(
            aerodb.figures.plot_comparison(both, "CL/basic"), tmp_path / f"{name}.{kind}"
        )
    assert (tmp_path / f"one.{kind}").read_bytes() == (tmp_path / f"two.{kind}").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"one.{kind}", f"two.{kind}"]


@pytest.mark.nightly
def test_svg_is_well_formed_and_states_what_it_shows(both, tmp_path):
    aerodb.figures.save_figure(
        aerodb.figures.plot_comparison(both, "CL/basic"), tmp_path / "lift.svg"
    )
    root = ElementTree.parse(tmp_path / "lift.svg").getroot()
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert "CL/basic, lift coefficient: clean aeroplane in steady flight" in "".join(
        root.itertext()
    )
    assert b"<dc:date>" not in (tmp_path / "lift.svg").read_bytes()


def test_other_formats_are_refused(small, tmp_path):
    with pytest.raises(SchemaError, match=r"the suffix is '.bmp'; allowed: .svg, .png, .pdf"):
        aerodb.figures.save_figure(aerodb.figures.plot_term(small, "CL/qhat"), tmp_path / "x.bmp")


def test_the_look_does_not_depend_on_the_settings_of_the_user(both):
    import matplotlib

    with matplotlib.rc_context({"axes.facecolor": "black", "lines.linewidth": 9.0}):
        figure = aerodb.figures.plot_comparison(both, "CL/basic")
    assert figure.axes[0].get_facecolor() == (1.0, 1.0, 1.0, 1.0)


def test_labels_move_apart_and_stay_inside():
    np.testing.assert_allclose(spread_apart(np.array([0.2, 0.8]), 0.1), [0.2, 0.8])
    np.testing.assert_allclose(spread_apart(np.array([0.5, 0.5, 0.5]), 0.1), [0.4, 0.5, 0.6])
    np.testing.assert_allclose(spread_apart(np.array([0.99, 1.0]), 0.1), [0.9, 1.0])
    moved = spread_apart(np.array([0.1, 0.12, 0.13, 0.5, 0.52]), 0.05)
    assert (np.diff(moved) > 0.05 - 1e-12).all()


@pytest.mark.nightly
def test_matplotlib_is_needed_only_when_a_figure_is_drawn():
    code = (
        "import sys; sys.modules['matplotlib'] = None\n"
        "import aerodb\n"
        "try:\n    aerodb.figures.plot_term\n"
        "except Exception as error:\n    print(type(error).__name__, error)"
    )
    printed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert (
        printed
        == "AeromatchError figures need matplotlib, which is not installed; run: pip install "
        "'aeromatch[figures]'\n"
    )


@pytest.mark.nightly
@pytest.mark.parametrize("databases", [1, 2, 3])
def test_labels_at_the_ends_of_curves_are_whole(small, databases):
    """No text leaves the sheet: a label cut at its edge reads as another number, 0.15 as 0.1."""
    mach = [0.15, 0.2125, 0.25]
    leaf = terms.make_term(
        np.outer([0.2, 0.21, 0.3], [-1.0, 0.0, 1.0]),
        {"mach": mach, "alpha": np.radians([-8.0, 0.0, 8.0])},
        stderr=0.05,
    )
    db = aerodb.replace_terms(small, {"CL/basic": leaf})
    figure = aerodb.figures.plot_comparison(
        {f"model {k}": db for k in range(databases)}, "CL/basic", "mach"
    )
    panels = figure.axes[:databases]
    for axes in panels:
        assert {"0.15", "0.2125", "0.25"} <= {item.get_text() for item in axes.texts}
    figure.set_dpi(200)
    sheet = figure.bbox
    edges = [axes.get_position().x0 * sheet.width for axes in panels[1:]] + [sheet.width]
    for axes, edge in zip(panels, edges):
        assert all(item.get_window_extent().x1 < edge for item in axes.texts)
