"""The moment of a force coefficient about a point, against the cross product with the rotated
axis.
"""

import numpy as np
import pytest

from aerodb.edit.levers import MOMENTS, Lever

ALPHA, BETA, ARM = 0.31, 0.23, np.array([0.7, -0.4, 1.3])


def axis_of(force):
    """Return the direction of a force coefficient of wind axes in body axes: turned by beta about
    z, then by -alpha about y.
    """
    ca, sa, cb, sb = np.cos(ALPHA), np.sin(ALPHA), np.cos(BETA), np.sin(BETA)
    turned_by_beta = np.array([[cb, -sb, 0.0], [sb, cb, 0.0], [0.0, 0.0, 1.0]])
    turned_by_alpha = np.array([[ca, 0.0, -sa], [0.0, 1.0, 0.0], [sa, 0.0, ca]])
    wind = {"CD": [-1.0, 0.0, 0.0], "CY": [0.0, 1.0, 0.0], "CL": [0.0, 0.0, -1.0]}[force]
    return turned_by_alpha @ turned_by_beta @ wind


@pytest.mark.parametrize("force", ["CD", "CY", "CL"])
def test_moment_of_a_force_in_wind_axes_is_arm_cross_axis(force):
    moments = [Lever("wind", force, moment, ARM).at(ALPHA, BETA) for moment in MOMENTS]
    np.testing.assert_allclose(moments, np.cross(ARM, axis_of(force)), atol=1e-15)
