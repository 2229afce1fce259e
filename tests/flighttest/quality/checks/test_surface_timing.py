"""Sign and time of a surface together: a simulated short period behind a 3-2-1-1, recorded early,
late and reversed.
"""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy.signal import lsim

from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.control_findings import _surface_findings
from flighttest.reconstruction.quality.checks.control_response import (
    control_responses,
    is_displaced,
)
from flighttest.reconstruction.quality.checks.signals import (
    BAND,
    ResampledChannels,
    lowpass_if_possible,
)
from flighttest.reconstruction.quality.checks.surface_timing import (
    LONGEST,
    SurfaceTiming,
    surface_timing,
)

STEP = 0.05
TIME = np.arange(0.0, 20.0, STEP)
EDGES = 4.0 + 0.7 * np.array([0.0, 3.0, 5.0, 6.0, 7.0])
SURFACE = 0.03 * sum(
    (-1) ** k * ((a <= TIME) & (b > TIME)) for k, (a, b) in enumerate(pairwise(EDGES))
)
A = np.array([[-1.5, -6.0], [1.0, -1.0]])  # q_dot, alpha_dot over q, alpha


def flown(surface):
    """Return what the aeroplane does: pitch acceleration, and the columns of the equation."""
    _, _, x = lsim((A, np.array([[-8.0], [0.0]]), np.eye(2), np.zeros((2, 1))), surface, TIME)
    q_dot = x @ A[0] - 8.0 * surface
    noise = np.random.default_rng(0).standard_normal(len(TIME))
    return q_dot + 0.003 * noise, [x[:, 0], x[:, 1]]


def timed(delay, sign):
    y, columns = flown(SURFACE)
    recorded = sign * np.interp(TIME - delay, TIME, SURFACE)
    active = (TIME > 2.5) & (TIME < 10.5)
    return surface_timing(y[active], [column[active] for column in columns], recorded, TIME, active)


@pytest.mark.slow
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("delay", [-0.2, 0.0, 0.2, 0.25, 0.3, 0.5])
def test_sign_and_delay_are_found_together(delay, sign):
    found = timed(delay, sign)
    assert found.sign == -sign  # a positive elevator pitches down
    assert found.lead == pytest.approx(-delay, abs=0.01)
    assert not found.bound
    assert 0.0 < found.stderr < 0.02


@pytest.mark.parametrize("delay", [2.3, -2.3])
def test_the_end_of_the_search_is_no_measurement(delay):
    found = timed(delay, 1)
    assert not found.bound or (abs(found.lead) == LONGEST and np.isinf(found.stderr))
    assert abs(found.lead + delay) > 0.1  # beyond the search: not found, and so
    assert found.bound or found.sign == 0 or found.explained < 0.9


def test_a_sine_shows_either_sign_or_half_a_period():
    y = -np.sin(2.0 * np.pi * TIME)  # 1 Hz: half a period is in reach
    mask = (TIME > 2.0) & (TIME < 18.0)
    late = surface_timing(y[mask], [], np.sin(2.0 * np.pi * (TIME - 0.24)), TIME, mask)
    assert late.sign == 0
    assert sorted((abs(late.lead), abs(late.other))) == pytest.approx([0.24, 0.26], abs=0.02)


def test_a_movement_from_before_the_record_has_no_time():
    """A pilot takes the ailerons at the begin of the record. With its first second they would look
    143 (20) ms early, with 0.05 of R2 and 1.1 deg of movement.
    """
    fine, aileron, p, phi = 0.0025, -0.07, 0.0135, 0.0
    rows = []
    for _ in range(round(30.0 / fine)):
        wanted = -0.035 - 0.9 * (0.05 - phi) + 0.5 * p
        aileron += np.clip(wanted - aileron, -0.7 * fine, 0.7 * fine)
        p += fine * (-3.5 * p - 8.0 * (aileron + 0.035))
        phi += fine * p
        rows.append((p, aileron))
    steps = round(STEP / fine)
    motion = np.array(rows[steps - 1 :: steps])
    noise = np.random.default_rng(0).standard_normal((4, len(motion))) * DEGREE
    values = {"p": motion[:, 0] + 0.03 * noise[0], "r": 0.03 * noise[3]}
    values["beta_vane"] = 0.08 * noise[2]
    filtered = {name: lowpass_if_possible(x, STEP, BAND) for name, x in values.items()}
    filtered["delta_a"] = motion[:, 1] + 0.03 * noise[1]
    valid = np.ones(len(motion), bool)
    signals = ResampledChannels(
        STEP * np.arange(len(motion)),
        filtered,
        good=dict.fromkeys(filtered, valid),
        flying=valid,
        step=STEP,
    )
    (row,) = control_responses(signals).itertuples()
    assert row.effect < 0.0
    assert row.movement < 0.7 * DEGREE
    timing = SurfaceTiming(
        row.lead, row.lead_stderr, row.gained, row.explained, row.bound, row.sign, row.other
    )
    assert not is_displaced(timing, row.movement)


@pytest.mark.parametrize(
    ("movement", "effect", "ratio", "severity", "kind"),
    [
        (0.06, 26.4, 7.2, "warning", "undecided"),
        (2.0, 26.4, 7.2, "error", "sign"),
        (0.8, 5.0, 127.0, "error", "sign"),
        (0.05, 97.5, 127.0, "error", "unit"),
    ],
)
def test_a_surface_that_hardly_moves_shows_no_sign(movement, effect, ratio, severity, kind):
    """First row: rudder of a real flight between the manoeuvres. Last row: rudder of a multisine,
    reversed, and in rad for deg.
    """
    record = xr.DataTree.from_dict({"/a": xr.Dataset({"delta_r": ("time", [0.0, 0.0])})})
    row = SimpleNamespace(
        **{"surface": "delta_r", "rate": "r", "effect": effect, "stderr": effect / ratio},
        **{"ratio": ratio, "R2": 0.55, "movement": movement * DEGREE, "sign": 1, "flow_late": 0.0},
    )
    (finding,) = _surface_findings(row, record, True)
    assert (finding.severity, finding.kind) == (severity, kind)
