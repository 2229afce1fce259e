"""Faults of the manoeuvres of a fit, by the names of the manoeuvres."""

import pytest
import xarray as xr

from flighttest.reconstruction.quality.manoeuvre_faults import report_faults


def test_every_manoeuvre_needs_a_name():
    with pytest.raises(ValueError, match="1 names for 2 manoeuvres; give one name for each"):
        report_faults([xr.Dataset(), xr.Dataset()], ["first"])
