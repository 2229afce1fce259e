"""Which cards of a plan flight records leave to be flown."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import xarray as xr

from flighttest.flight_programme.planning import coverage
from flighttest.flight_programme.planning.catalogue import PlannedFit

MARKS = pd.DataFrame(
    {"name": ["doublet", "bank", "climb"], "start": [0.0, 10.0, 20.0], "end": [9.0, 19.0, 29.0]}
)


def test_a_manoeuvre_that_no_fit_can_use_is_not_done(monkeypatch):
    """A bank without movement determines nothing; a climb is in no fit, so flying it is enough."""
    manoeuvres = []
    for name in MARKS["name"]:
        marked = MARKS[MARKS["name"] == name]
        manoeuvres.append(SimpleNamespace(name=name, marked=lambda table, marked=marked: marked))
    fits = [
        PlannedFit(name="pitch", manoeuvres=("doublet",), models=("Cm = 1 + alpha",)),
        PlannedFit(name="roll", manoeuvres=("bank",), models=("Cl = 1 + beta",)),
    ]
    catalogue = SimpleNamespace(manoeuvre=manoeuvres, fit=fits, condition=(), errors={}, cutoff=2.0)
    time = np.arange(0.0, 30.0, 0.1)
    rng = np.random.default_rng(1)
    columns = {"alpha": 0.05 * np.sin(time), "beta": 0.0 * time, "Cl": 0.0 * time}
    columns["Cm"] = 0.1 - 0.6 * columns["alpha"] + 1e-4 * rng.standard_normal(time.size)
    data = xr.Dataset({name: ("time", x) for name, x in columns.items()}, {"time": time})
    monkeypatch.setattr(coverage, "coefficients", lambda *given: data)
    monkeypatch.setattr(coverage, "marked_manoeuvres", lambda record: MARKS)
    monkeypatch.setattr(coverage, "nearest_condition", lambda conditions, data: "cruise")
    found = coverage.flights_of(catalogue, {"one": None}, {"one": None}, aircraft=None)
    assert [fit.name for fit in found.fits] == ["one: pitch"]
    assert found.done == [("cruise", "doublet"), ("cruise", "climb")]
    assert found.undetermined == [("cruise", "bank")]
