"""Tests of remarks on opened terms that no manoeuvre of the fits identifies."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from aeromatch.planning.term_remarks import flown_ranges, term_remarks
from aeromatch.project.model_sections import NewTerm

DEG = np.pi / 180.0
MODELS = ("Cm = 1 + alpha + qhat + delta_e + CT", "Cn = 1 + beta + rhat + delta_r")
FLOWN = {"fit 'all'": {"alpha": (-1.0 * DEG, 6.0 * DEG), "delta_f": (0.0, 0.0)}}


def remarks_on(path: str, **term: object) -> list[str]:
    fit = SimpleNamespace(name="all", models=MODELS)
    project = SimpleNamespace(terms={path: NewTerm(stderr=0.1, **term)}, fit=[fit])
    return list(term_remarks(project, FLOWN))


@pytest.mark.parametrize(
    ("path", "term", "text"),
    [
        ("Cm/power", {"regressors": ("delta_r",)}, "no fit of Cm has its regressor delta_r, so"),
        ("Cm/power", {"regressors": ("CT",)}, ""),
        ("Cm/gear", {"regressors": ("gear",)}, ""),
        ("Cn/rudder", {"axes": {"alpha": ("0 deg", "6 deg")}, "regressors": ("delta_r",)}, ""),
        ("Cn/basic", {"axes": {"alpha": ("-2 deg", "6 deg", "9 deg")}}, ""),
        ("Cn/basic", {"axes": {"alpha": ("0 deg", "6 deg", "60 deg")}}, "its nodes at 60 deg"),
        ("Cn/flap", {"axes": {"delta_f": ("0 deg", "40 deg")}}, "axis delta_f stays at 0 deg in"),
        ("Cn/mach", {"axes": {"mach": (0.1, 0.2)}}, ""),
        ("CL/other", {"regressors": ("delta_r",)}, ""),
    ],
)
def test_a_term_that_no_manoeuvre_identifies(path: str, term: dict, text: str) -> None:
    found = remarks_on(path, **term)
    assert len(found) == bool(text)
    assert text in "".join(found)


def test_ranges_of_the_flown_samples() -> None:
    values = {"alpha": ("time", [0.1, 0.2, np.nan, 0.9]), "delta_f": ("time", np.zeros(4))}
    states = xr.Dataset(values, {"time": np.arange(4.0)}, {"unknown": "delta_f"})
    assert flown_ranges(states, np.array([0, 1, 2])) == {"alpha": (0.1, 0.2)}
