"""Units of the stacked arrays."""

from pathlib import Path

import numpy as np

import datcom_io

CLEAN = Path(__file__).parents[3] / "data" / "t37" / "datcom" / "t37_clean.out"


def test_angle_of_a_derivative_is_the_one_in_the_heading_of_its_page():
    """The heading decides, not the card DERIV: a case of another run may stand under the cards of
    this one.
    """
    text = CLEAN.read_text(encoding="latin-1")
    assert "(PER RADIAN)" in text
    per_radian = datcom_io.read(text.split("\n"))[0].to_datatree()
    per_degree = datcom_io.read(text.replace("(PER RADIAN)", "(PER DEGREE)").split("\n"))[
        0
    ].to_datatree()
    for page, name in (
        ("static", "CL_alpha"),
        ("static", "Cn_beta"),
        ("dynamic", "CL_qhat"),
        ("dynamic", "Cl_phat"),
    ):
        one, other = per_radian[page][name], per_degree[page][name]
        assert np.isfinite(one).any()
        np.testing.assert_allclose(other, one * 180.0 / np.pi, rtol=1e-12)
    np.testing.assert_array_equal(per_degree["static"]["CL"], per_radian["static"]["CL"])
