"""The path that the inertial unit drives: against the truth, and its sensitivities against
differences.
"""

import copy

import numpy as np
import pytest

from flighttest.reconstruction.batch.unknowns import path_of, path_sensitivities, window_slices
from flighttest.reconstruction.problem.assembly import assemble_problem
from flighttest.reconstruction.problem.driving import SCALES


@pytest.fixture(scope="module")
def setup(flown, aircraft):
    craft = copy.deepcopy(aircraft)
    craft.instruments["imu"]["scale_sigma"] = {name.split(".")[1]: 1e-3 for name in SCALES}
    record = flown(0, duration=20.0)[0]
    return assemble_problem(record, craft, [(0.0, 9.0), (10.0, 20.0)])


def starts_of(setup):
    return setup.x[setup.problem.starts]


def test_error_free_inputs_lead_to_the_true_path(flown, aircraft):
    record, error, truth = flown(0, noise=0.0)
    setup = assemble_problem(record, aircraft, [(0.0, 40.0)])
    c = np.array(
        [
            error.get(name, value)
            for name, value in zip(setup.problem.constants.names, setup.c, strict=True)
        ]
    )
    start = setup.x[:1].copy()
    start[0, :7] = truth[["phi", "theta", "psi", "vn", "ve", "vd", "h"]].isel(time=0).to_array()
    x = setup.x
    for _ in range(2):
        x = path_of(setup.problem, start, c, x)
    # cubics between samples, 0.9 Hz at 50 Hz: (omega dt)^4/720 of the accelerations, 4e-8 rad and
    # 1.4e-5 m/s seen after 40 s;
    # straight lines left 6e-5 rad and 0.012 m/s
    assert np.abs(x[:, :3].T - truth[["phi", "theta", "psi"]].to_array().values).max() < 1e-7
    assert np.abs(x[:, 3:6].T - truth[["vn", "ve", "vd"]].to_array().values).max() < 5e-5
    assert np.abs(x[:, 6] - truth["h"]).max() < 3e-3


def test_sensitivities_are_those_of_the_path(setup):
    problem, starts, c = setup.problem, starts_of(setup), setup.c
    found = path_sensitivities(problem, starts, c, setup.x, np.ones(len(c), bool))
    n = problem.states
    names = [problem.constants.names[i] for i in found.columns]
    steps = {**{i: s for i, s in enumerate([1e-4] * 3 + [0.1] * 3 + [1.0] + [1e-3] * 2)}}
    scale = np.abs(found.X).max(axis=(0, 2), keepdims=True)
    assert scale.min() > 0.0
    for j in range(n + len(names)):
        sides = []
        for sign in (1.0, -1.0):
            moved, values = starts.copy(), c.copy()
            if j < n:
                moved[:, j] += sign * steps[j]
            else:
                values[found.columns[j - n]] += sign * 1e-4
            sides.append(path_of(problem, moved, values, setup.x))
        step = steps[j] if j < n else 1e-4
        numeric = (sides[0] - sides[1]) / (2.0 * step)
        size = np.maximum(np.abs(numeric).max(axis=0), 1e-6)
        # the trapezoidal rule of the sensitivities: (omega dt)^2/12 of their size
        assert (np.abs(found.X[:, :, j] - numeric).max(axis=0) / size).max() < 1e-3, (
            j,
            names[j - n] if j >= n else "start",
        )


def test_segments_begin_where_the_windows_do(setup):
    parts = window_slices(setup.problem)
    assert [setup.problem.time[part][[0, -1]].tolist() for part in parts] == [
        [0.0, 9.0],
        [10.0, 20.0],
    ]
