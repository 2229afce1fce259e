"""Tests of the files of a model: an implausible database is written with a warning."""

import pytest

import aerodb
import flightmech
from aeromatch.rebuilding.products import model_files
from flightmech.errors import AeromatchWarning
from flightmech.support.kept_stages.stages import Stages
from flightmech.terms import make_term

ROOT = {"title": "x", "aircraft": "x", "S": 16.0, "cbar": 1.6, "b": 10.0, "source": "x"}
ROOT |= {"x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0, "force_axes": "stability", "history": "x"}
NUMBERS = {"S": 16.0, "cbar": 1.6, "b": 10.0, "mass": 1000.0, "Ixx": 1e3, "Iyy": 2e3, "Izz": 3e3}


def test_the_notices_of_a_written_database_hold_what_is_implausible(tmp_path) -> None:
    aircraft = flightmech.Aircraft("x", **NUMBERS)
    terms = {
        "CL/alpha": make_term(5.0, regressors=["alpha"]),
        "CD/basic": make_term(0.03),
        "Cm/alpha": make_term(0.5, regressors=["alpha"]),
    }
    stages = Stages()
    database = stages.given(aerodb.make_database(terms, **ROOT))
    with pytest.warns(AeromatchWarning, match="datcom: static margin = -0.1 is implausible"):
        files = model_files(stages, "datcom", database, stages.given(aircraft)).value
    (tmp_path / "datcom.nc").write_bytes(files["datcom.nc"])
    notices = aerodb.open(tmp_path / "datcom.nc").attrs["notices"]
    assert "static margin = -0.1 is implausible" in notices
