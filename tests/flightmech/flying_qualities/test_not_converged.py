"""Searches that end without convergence: the characteristics state it."""

import numpy as np
import pytest
import scipy
from scipy.optimize import RootResults

from flightmech.errors import SimulationError
from flightmech.flying_qualities import longitudinal, performance
from flightmech.steady_flight.trim_point import trimmed_at


@pytest.fixture(scope="module")
def point(plain_aircraft, plain_tree):
    return trimmed_at(plain_aircraft(), plain_tree(), {"V": 90.0, "h": 1500.0})


@pytest.fixture
def short_search(monkeypatch):
    """A secant search that ends before it converges."""

    def stop(residual, x0, x1, **options):
        return RootResults(
            root=x1, iterations=50, function_calls=52, flag="iteration limit", method="secant"
        )

    monkeypatch.setattr(scipy.optimize, "root_scalar", stop)


def test_a_point_without_convergence_is_absent(short_search, point):
    rows = {row.quantity: row for row in longitudinal.longitudinal_rows(point)}
    for name in ("neutral_point_fixed", "static_margin_fixed", "manoeuvre_point_fixed"):
        assert np.isnan(rows[name].value)
        assert "did not converge" in rows[name].absent
    assert np.isfinite(rows["x_cg"].value)


def test_a_stall_without_convergence_states_it(monkeypatch, point):
    converged = performance.stall(point)
    assert "not converged" not in converged.why
    monkeypatch.setattr(performance, "_STALL_PASSES", 1)
    monkeypatch.setattr(performance, "_MACH_TOLERANCE", 0.0)
    assert "not converged" in performance.stall(point).why


def test_an_elevator_without_balance_is_left_out(monkeypatch, point):
    monkeypatch.setattr(performance, "_BALANCED", 0.0)  # no moment is below it
    with pytest.raises(SimulationError, match="at no angle of attack"):
        performance.polar(point)
