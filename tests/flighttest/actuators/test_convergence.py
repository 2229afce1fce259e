"""Searches of an actuator that stop at their iteration limit: remarks, JSON, report, warning."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[3] / "examples" / "flapping_vehicle"))
import actuator_bench as bench

from flightmech.errors import AeromatchWarning
from flighttest.remarks import is_forbidden
from flighttest.submodels.actuators import estimation, output_error
from flighttest.submodels.actuators.identification import identify_actuator


def logs():
    return [bench.log(bench.SERVO, bench.Campaign(duration=6.0), seed) for seed in (1, 2)]


def identify():
    return identify_actuator(logs(), held=True, limits=False)


def of_convergence(actuator):
    return [remark for remark in actuator.remarks if remark.kind == "convergence"]


@pytest.fixture(scope="module")
def complete():
    return identify()


def test_converged_searches_say_so_without_a_remark(complete):
    assert complete.as_dict()["converged"] is True
    assert complete.as_dict()["instruments"]["converged"] is True
    assert complete.spectral.convergence.change <= 1.0
    assert not of_convergence(complete)
    assert "iterations 4, converged" in complete.report()


@pytest.mark.nightly
def test_instruments_that_do_not_converge_fall_back_to_least_squares_with_a_remark(
    complete, monkeypatch
):
    # After one round the largest change is 47 tolerances; it converges in the second one.
    monkeypatch.setattr(estimation, "_ROUNDS", 1)
    stopped = identify()
    assert not stopped.spectral.convergence.converged
    assert stopped.spectral.convergence.change > 1.0
    assert stopped.spectral.values["Ka/Ma"] != complete.spectral.values["Ka/Ma"]
    (remark,) = of_convergence(stopped)
    assert remark.severity == "warning"
    assert "instruments of the equation error: not converged after 1 iterations" in remark.text
    assert "least squares" in stopped.report()
    assert stopped.as_dict()["instruments"]["converged"] is False
    # The output error gives the result and does not depend on the instruments.
    assert not is_forbidden(stopped.remarks)


@pytest.mark.nightly
def test_an_output_error_that_stops_at_its_limit_forbids_the_entry_of_a_name_map(monkeypatch):
    monkeypatch.setattr(output_error, "ITERATIONS", 1)
    stopped = identify()
    assert stopped.as_dict()["converged"] is False
    assert is_forbidden(stopped.remarks)
    assert "NOT converged" in stopped.report()
    with pytest.warns(AeromatchWarning, match="entry of delta_e: not converged after 1 iterations"):
        stopped.channel("delta_e")
    # The search of each log alone also stops. Its estimates are not averaged.
    assert stopped.over_logs().empty
    texts = [remark.text for remark in of_convergence(stopped)]
    assert (
        sum("on this log alone is not converged after 1 iterations" in text for text in texts) == 2
    )


@pytest.mark.slow
def test_a_search_of_the_dead_time_that_stops_at_its_limit_warns(monkeypatch):
    monkeypatch.setattr(estimation, "_EVALUATIONS", 2)
    with pytest.warns(AeromatchWarning, match="dead time of the equation error: not converged"):
        identify()
