"""Options that a verb of identification would ignore, and numbers in texts that are not finite."""

from dataclasses import replace

import pytest
from click.testing import CliRunner

from flightmech.errors import SchemaError, UnitError
from flighttest.cli.actions.estimators import EstimatorOptions
from flighttest.cli.actions.identify import DisturbanceOptions
from flighttest.cli.actions.manoeuvres import assign_windows
from flighttest.cli.actions.submodels.controls import _table_nodes
from flighttest.cli.group import flight


@pytest.fixture
def refusal(tmp_path, monkeypatch):
    """Return a function that states why a verb refuses its options before it reads p.nc."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "p.nc").touch()

    def state(*words):
        done = CliRunner().invoke(flight, words)
        assert done.exit_code != 0
        return f"{done.output} {done.exception}"

    return state


@pytest.mark.parametrize("disturbance", ["none", "process"])
@pytest.mark.parametrize("words", [("--span", "18"), ("--scale", "150"), ("--angle", "vane")])
def test_options_of_gusts_without_gusts(refusal, disturbance, words):
    command = ("fit-linear", "p.nc", "--motion", "lateral", "--disturbance", disturbance, *words)
    text = refusal(*command)
    assert f"{words[0]} with --disturbance {disturbance}: only gusts use it" in text
    assert "give --disturbance gusts or both" in text


def test_options_of_gusts_with_gusts():
    DisturbanceOptions("none", None, None, 0.0).check()
    DisturbanceOptions("both", "vane", 150.0, 18.0).check()


@pytest.mark.parametrize("limit", ["inf", "inf%", "nan", "1e999"])
def test_a_goal_is_finite(refusal, limit):
    """Each estimate would reach an infinite standard error."""
    text = refusal("follow", "p.nc", "--model", "CL = 1 + alpha", "--until", "alpha", limit)
    assert f"--until alpha '{limit}'; a positive standard error or share" in text


@pytest.mark.parametrize("edges", ["0 5 inf deg", "nan 5", "-inf 0 5 deg"])
def test_edges_of_bins_are_finite(refusal, edges):
    model = ("--model", "CL = 1 + alpha", "--aircraft", "p.nc")
    text = refusal("partition", "p.nc", *model, "--over", "alpha", edges)
    assert f"edges of alpha are '{edges}'; expected finite numbers" in text


OPTIONS = EstimatorOptions(
    method="least-squares",
    intercepts="common",
    band=None,
    weights="equal",
    ridge="0",
    prior=None,
    noises=(),
    instrument_files=(),
    constraints=(),
)


@pytest.mark.parametrize("ridge", ["inf", "nan", "much"])
def test_a_ridge_is_finite(ridge):
    with pytest.raises(SchemaError, match=f"--ridge is '{ridge}'; expected a number or auto"):
        replace(OPTIONS, ridge=ridge)._ridge_parameter()


def test_a_size_of_noise_is_finite():
    assert replace(OPTIONS, noises=(("alpha", "0.01"),))._noise_in_si() == {"alpha": 0.01}
    with pytest.raises(UnitError, match="--noise alpha: found 'inf'; expected a number"):
        replace(OPTIONS, noises=(("alpha", "inf"),))._noise_in_si()


def test_nodes_of_a_table_are_finite():
    assert _table_nodes("mach 0.2, 0.5") == ("mach", (0.2, 0.5))
    with pytest.raises(SchemaError, match="--over is 'mach inf'; give a variable and its nodes"):
        _table_nodes("mach inf")


def test_a_window_of_inertia_is_taken_once(refusal):
    words = ("p.nc", "--aircraft", "p.nc", "--model", "Cm = 1", *2 * ("--window", "0", "8"))
    text = refusal("inertia", *words)
    assert "p: 0 ... 8 s is taken twice; take it once" in text


def test_a_part_of_a_path_is_taken_once():
    """Common windows, and those of one path."""
    own = [("b", 10.0, 18.0)]
    assert assign_windows(("a.nc", "b.nc"), ((0.0, 8.0),), own) == [
        [(0.0, 8.0)],
        [(0.0, 8.0), (10.0, 18.0)],
    ]
    with pytest.raises(SchemaError, match=r"a: 0 \.\.\. 8 s is taken twice; take it once"):
        assign_windows(("a.nc",), ((0.0, 8.0), (0.0, 8.0)))
    with pytest.raises(SchemaError, match=r"b: 1 \.\.\. 5 s is taken twice; take it once"):
        assign_windows(("a.nc", "b.nc"), ((0.0, 8.0),), [("b", 1.0, 5.0)])
