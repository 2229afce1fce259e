"""CSV of DATCOM+: the file is made here in the layout that public readers of such files expect; no
original was at hand.
"""

import math

import numpy as np
import pytest

import datcom_io
from datcom_io.cells import FILLED, NDM, OK
from flightmech.errors import ParseError, UnknownName

DEG = math.pi / 180.0
TEXT = """****************************************
*   OWN NUMBERS, CITATION-LIKE         *
****************************************

Alpha, Cd
  -2.0, .1981E-01
   0.0, .1850E-01
   2.0, .2003E-01

Alpha, Cyb
  -2.0, -.1357E-01
   0.0, -.1000E-29
   2.0, -.1000E-29
Alpha, Epslon
  -2.0, .1570E+00
   0.0, .1110E+01
   2.0, .2116E+01

Alpha, Cmq
  -2.0, -.2500E+00
   0.0, -.1000E-29
   2.0, -.1000E-29

DeltaElev, Cm_Elev
 -10.0,  .2592E+00,
  10.0, -.2592E+00,

DeltaElev, Chd_Elev
 -10.0, -.7656E-02
  10.0, .1000E-29

Alpha, DeltaElev
      , -10.0, 10.0
  -2.0, .6080E-02, .1870E-02
   0.0, .4870E-02, .3080E-02
   2.0, .3720E-02, .4240E-02

DeltaAil, Cl_Ail
  -5.0, .1000E-01
   5.0, -.1000E-01
"""


@pytest.fixture
def written(tmp_path):
    def write(text):
        path = tmp_path / "own.csv"
        path.write_text(text)
        return path

    return write


def test_blocks_become_leaves(written):
    tree = datcom_io.exchange.read_datcom_plus_csv(written(TEXT), deriv="DEG")
    assert list(tree.children) == ["static", "downwash", "dynamic", "elevator", "other"]
    np.testing.assert_allclose(tree["static"]["alpha"], np.array([-2.0, 0.0, 2.0]) * DEG)
    np.testing.assert_array_equal(tree["static"]["CD"], [0.01981, 0.0185, 0.02003])
    np.testing.assert_allclose(tree["static"]["CY_beta"], -0.01357 / DEG)
    assert tree["static"]["CY_beta_flag"].values.tolist() == [OK, FILLED, FILLED]
    np.testing.assert_allclose(tree["downwash"]["epsilon"], np.array([0.157, 1.11, 2.116]) * DEG)
    np.testing.assert_allclose(tree["dynamic"]["Cm_qhat"], -0.25 / DEG)
    elevator = tree["elevator"]
    np.testing.assert_array_equal(elevator["dCm"], [0.2592, -0.2592])
    assert elevator["Ch_delta_flag"].values.tolist() == [OK, NDM]
    assert float(elevator["Ch_delta"][0]) == pytest.approx(-0.007656 / DEG)
    np.testing.assert_array_equal(
        elevator["dCDi"].sel(delta=10.0 * DEG, method="nearest"), [0.00187, 0.00308, 0.00424]
    )
    (aileron,) = tree["other"].data_vars.values()
    assert aileron.attrs["heading"] == "DeltaAil, Cl_Ail"
    np.testing.assert_array_equal(aileron, [[-5.0, 0.01], [5.0, -0.01]])
    assert tree.attrs["remarks"] == "line 2: OWN NUMBERS, CITATION-LIKE"


def test_per_radian(written):
    tree = datcom_io.exchange.read_datcom_plus_csv(written(TEXT), deriv="RAD")
    np.testing.assert_array_equal(tree["dynamic"]["Cm_qhat"], -0.25)
    assert float(tree["elevator"]["Ch_delta"][0]) == pytest.approx(
        -0.007656 / DEG
    )  # per degree whatever DERIV is
    with pytest.raises(UnknownName, match="unit of the derivatives"):
        datcom_io.exchange.read_datcom_plus_csv(written(TEXT), deriv="GRAD")


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("   0.0, .1850E-01\n", "   0.0, abc\n", "line 7: found 'abc'"),
        ("   0.0, .1850E-01\n", "   0.0\n", "line 7: found '0.0' outside a block"),
        ("   0.0, .1850E-01\n", "", "line 9: found other angles of alpha in Alpha, Cyb"),
        (
            "   0.0, .1850E-01\n",
            "\n   0.0, .1850E-01\n",
            "line 8: found '0.0, .1850E-01' outside a block",
        ),
        (
            "   0.0, .1850E-01\n",
            "   0.0, .1, .2\n",
            "line 7: found 3 numbers in a row of the block Alpha, Cd",
        ),
        ("      , -10.0, 10.0\n", "", "a number above the angles of attack"),
        ("      , -10.0, 10.0\n", "      , ,\n", "found 0 deflections and 3 rows"),
        ("Alpha, Epslon\n", "Alpha, Cd\n", "a second block Alpha, Cd"),
        (
            "Alpha, Epslon\n",
            "Alpha, Epslon\nAlpha, CL\n",
            "line 14: found the heading Alpha, Epslon without numbers",
        ),
    ],
)
def test_faults(written, old, new, text):
    with pytest.raises(ParseError, match=text):
        datcom_io.exchange.read_datcom_plus_csv(written(TEXT.replace(old, new, 1)), deriv="DEG")


def test_blank_line_below_a_heading(written):
    tree = datcom_io.exchange.read_datcom_plus_csv(
        written(TEXT.replace("Alpha, Cd\n", "Alpha, Cd\n\n")), deriv="DEG"
    )
    assert tree["static"]["CD"].size == 3


def test_foreign_file(written):
    with pytest.raises(ParseError, match="no block of numbers"):
        datcom_io.exchange.read_datcom_plus_csv(written("time,alpha\n"), deriv="DEG")
