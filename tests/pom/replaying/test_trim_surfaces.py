"""Trim surfaces that the trim solves for: Newton's method on short starts of a model."""

from types import SimpleNamespace

import numpy as np
import pytest

from flightmech.errors import SchemaError
from pom.cases.case import read_case
from pom.cases.job import ReplayJob
from pom.replaying import trim as module

TIME = np.arange(0.0, 2.0, 0.02)
JOB = ReplayJob(TIME, {"delta_t": 0.02 + 0.0 * TIME, "delta_tr": 0.0 * TIME}, {}, (), ())
OUTPUTS = ("trim.F_column", "trim.F_pedal")


def model(outputs=OUTPUTS):
    return SimpleNamespace(links=SimpleNamespace(inputs=("delta_t", "delta_tr"), outputs=outputs))


@pytest.fixture
def forces(monkeypatch):
    """A model whose forces are a function of both trim surfaces; returns how long its starts
    were.
    """
    lengths = []

    def answer(law):
        def fly(model, job, wanted, timeout, store):
            lengths.append(len(job.time))
            found = law(job.inputs["delta_t"][0], job.inputs["delta_tr"][0])
            return {
                name: np.full(len(job.time), value)
                for name, value in zip(OUTPUTS, found, strict=True)
            }, ""

        monkeypatch.setattr(module, "fly_job", fly)
        return lengths

    return answer


def test_both_forces_are_taken_away(forces):
    """Two surfaces that work on each other's force, one of them not quite linearly."""
    lengths = forces(
        lambda t, tr: (30.0 - 900.0 * t - 4000.0 * t**3 + 50.0 * tr, -8.0 + 20.0 * t + 400.0 * tr)
    )
    job, remarks, failure = module.solve_trim_surfaces(JOB, ("delta_t", "delta_tr"), model(), 1.0)
    t, tr = job.inputs["delta_t"], job.inputs["delta_tr"]
    assert failure == ""
    assert np.ptp(t) == np.ptp(tr) == 0.0  # a constant each
    assert abs(30.0 - 900.0 * t[0] - 4000.0 * t[0] ** 3 + 50.0 * tr[0]) < module.SURFACES_LEFT
    assert abs(-8.0 + 20.0 * t[0] + 400.0 * tr[0]) < module.SURFACES_LEFT
    assert remarks[0].values["bias"] == pytest.approx(np.degrees(t[0] - 0.02))
    assert set(lengths) == {module.SAMPLES}


def test_a_surface_without_effect_stays_as_recorded(forces):
    forces(lambda t, tr: (30.0 - 900.0 * t, 12.0))
    job, remarks, _ = module.solve_trim_surfaces(JOB, ("delta_t", "delta_tr"), model(), 1.0)
    assert job.inputs["delta_t"][0] == pytest.approx(30.0 / 900.0, abs=1e-4)
    assert not job.inputs["delta_tr"].any()
    assert "delta_tr has no effect on trim.F_pedal" in remarks[1].text


def test_a_model_that_lacks_the_force_is_refused_in_words():
    _, _, failure = module.solve_trim_surfaces(JOB, ("delta_t",), model(outputs=()), 1.0)
    assert "the model has no output trim.F_column" in failure
    assert module.solve_trim_surfaces(JOB, (), model(outputs=()), 1.0) == (JOB, (), "")


def test_only_forces_leave_a_trim_surface_free(write_case):
    with pytest.raises(
        SchemaError,
        match="trim_surfaces: a trim surface is solved for where recorded forces hold the controls",
    ):
        read_case(write_case("2.c.5", more='trim_surfaces = ["delta_t"]\n[events]\ncapture = 5.0'))
    case = read_case(
        write_case(
            "2.c.5", more='surfaces = "force"\ntrim_surfaces = ["delta_t"]\n[events]\ncapture = 5.0'
        )
    )
    assert case.drive.trim_surfaces == ("delta_t",)
    assert type(case).from_dict(case.to_dict()) == case
