"""The pages of the databases and of the identification: what differs, local models, shared
figures.
"""

import re

import numpy as np
import pytest
import report_fixture as fixture
import xarray as xr
from report_pages import page, parcels

from flightmech import terms
from pom.report.case import page as case
from pom.report.models import database_comparison, identification, term_figures
from pom.report.presentation import quantities, traces


@pytest.mark.slow
def test_models_page_shows_what_differs_and_names_the_rest(report):
    html, _ = report
    drawn = dict(
        re.findall(
            r'data-term="([^"]+)" id="[^"]*">\s*<h2>[^<]*<span class="quiet">(?:[^<;]+; '
            r")?((?:not in|replaced|unch)[^<;]*)",
            html,
        )
    )
    assert drawn == {
        "CL/basic": "replaced",
        "CL/gear": "not in datcom",
        "CL/qhat": "replaced",
        "CL/tab": "not in final",
        "CD/basic": "unchanged",
        "Cm/basic": "unchanged",
        "Cm/elevator": "replaced",
    }
    assert re.search(
        r'scope="row">CL/flap</th><td>lift increment due to flap extension</td><td>alpha 11, '
        r"delta_f 3",
        html,
    )


def test_changes_state_what_the_last_database_does_to_the_first(report):
    """A third database has no part in them."""
    html, _ = report
    table = html.partition('class="plain changes"')[2].partition("</table>")[0]
    states = dict(
        re.findall(r'<th scope="row">.*?>([^<]+)</a></th>.*?class="quiet">(\w+)</td>', table)
    )
    assert states["CL/gear"] == "added"
    assert states["CL/tab"] == "removed"
    assert states["CL/basic"] == "replaced"


@pytest.mark.parametrize(
    "order",
    [("Ch_e/basic", "Ch_a/basic", "Ch_r/basic"), ("Ch_r/basic", "Ch_e/basic", "Ch_a/basic")],
)
def test_terms_of_the_same_place_come_in_the_order_of_the_databases(order):
    """Not in that of a set, which is another one in every process."""
    made = [
        xr.DataTree.from_dict(
            {"/": xr.Dataset(attrs=fixture.databases()["final"].attrs)}
            | {name: terms.make_term(value) for name in order}
        )
        for value in (0.1, 0.2)
    ]
    found = database_comparison.compare_for_report(
        dict(zip(("datcom", "final"), made, strict=True)), {}, {"datcom": "run-0", "final": "run-1"}
    )
    assert tuple(item["term"] for item in found["terms"]) == order


@pytest.mark.slow
def test_supporting_samples_are_drawn_in_their_slice():
    import pandas as pd

    support = {
        "CL/basic": pd.DataFrame({"alpha": np.radians([1.0, 2.0, 3.0]), "mach": [0.12, 0.28, 0.31]})
    }
    results, databases = [fixture.roll_result()], fixture.databases()
    html = page(results, databases=databases, support=support)
    section = html[html.index('data-term="CL/basic"') : html.index('data-term="CL/gear"')]
    assert section.count('class="rug"') == 1 + 3  # the key and three samples
    assert page(results, databases=databases).count('class="rug"') == 0


def test_identification_shows_every_local_model():
    fits = fixture.fits()
    head, body = parcels(page([fixture.roll_result()], fits))["identification"]
    html = head["page"]
    assert html.count('<details class="fit"') == len(head["fits"]) == 2
    for fit, drawn in zip(fits, head["fits"], strict=True):
        measured, fitted = (
            traces.restore_trace(drawn[name], body) for name in ("measured", "fitted")
        )
        lift = fit.data["CL"].values
        assert np.abs(measured - lift).max() <= np.ptp(lift) / 1000 * (1 + 1e-9)
        assert np.std(measured - fitted) == pytest.approx(np.std(fit.residual), rel=0.02)
        assert drawn["starts"] == [300]
        for name, estimate in zip(
            fit.estimates["term"].values, fit.estimates["estimate"].values, strict=True
        ):
            assert re.search(
                rf'scope="row">{name}</th><td '
                rf'class="num">{re.escape(quantities.format_number(float(estimate), 4))}</td>',
                html,
            )
    assert 'class="test-point"' in html
    assert "Correlated estimates: 1 with alpha" in html
    assert "identification" not in parcels(page([fixture.roll_result()]))


def test_the_bar_of_an_estimate_spans_two_standard_errors():
    bar = identification._error_bar(3.0, 0.5)
    assert (bar["at"] - bar["zero"]) / (bar["high"] - bar["at"]) == pytest.approx(3.0, rel=0.01)
    assert bar["high"] - bar["at"] == pytest.approx(bar["at"] - bar["low"], abs=0.11)
    assert identification._error_bar(0.0, 0.0) is None


def test_tables_of_unlike_axes_share_a_figure():
    from flightmech import terms

    alpha, mach = np.radians([0.0, 10.0]), [0.2, 0.6]
    holders = {
        "wide": terms.make_term([[1.0, 2.0], [3.0, 4.0]], {"alpha": alpha, "mach": mach}),
        "narrow": terms.make_term([[5.0], [7.0]], {"alpha": alpha, "mach": [0.3]}),
        "flat": terms.make_term([8.0, 10.0], {"mach": [0.2, 0.4]}, stderr=0.1),
        "scalar": terms.make_term(6.0),
    }
    tables = {name: leaf["value"] for name, leaf in holders.items()}

    def cut(mach):
        curves = term_figures._cut_curves(
            tables, holders, quantity="value", x_axis="alpha", position={"mach": mach}
        )
        return {curve.database: curve for curve in curves}

    curves = cut(0.6)
    np.testing.assert_allclose(curves["wide"].y, [2.0, 4.0])
    np.testing.assert_allclose(curves["narrow"].y, [5.0, 7.0])  # one node only: held
    np.testing.assert_allclose(curves["flat"].y, [10.0, 10.0])  # beyond its last node: held
    np.testing.assert_allclose(curves["scalar"].y, [6.0, 6.0])
    for curve in curves.values():
        np.testing.assert_allclose(curve.x, [0.0, 10.0])
    np.testing.assert_allclose(cut(0.3)["wide"].y, [1.25, 3.25])
    (figure,) = term_figures.term_figures(
        "CL/basic", holders, support=None, styles=case.run_line_classes(holders)
    )
    assert figure.words.startswith("CL/basic value against alpha in")


def test_databases_that_hold_the_same_table_share_a_line():
    from flightmech import terms

    leaf = terms.make_term([1.0, 2.0], {"mach": [0.2, 0.6]})
    other = terms.make_term([1.0, 2.5], {"mach": [0.2, 0.6]})
    narrower = terms.make_term([1.0, 2.0], {"mach": [0.2, 0.6]}, stderr=0.1)
    assert term_figures._group_identical(
        {"a": leaf, "b": other, "c": leaf.copy(), "d": narrower}
    ) == {
        "a": ["a", "c"],
        "b": ["b"],
        "d": ["d"],
    }
