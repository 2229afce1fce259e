"""Identification against printed numbers.

Pooling: Grauer, Ulrich, Hubbard, Pines, Humbert, AIAA 2010-7632, Tables 1 to 3 (two estimates with
standard errors and their published average).  Derivatives: gains of local polynomials at 50 samples
per second, identification reference 2.1 of the project, computed independently of this code.
"""

import pytest

from flighttest.records.signals.differentiation import derivative_gain, derivative_noise
from flighttest.regression.combining.pooling import pool

# name: first estimate, its error, second, its error, published average, its error
AVERAGED = {
    "motor Ma": ("0.2265", "0.0051", "0.2207", "0.2149", "0.2264", "0.0070"),
    "motor Ca": ("0.8861", "0.0224", "1.0069", "0.2477", "0.8961", "0.0291"),
    "motor B": ("-0.5838", "0.0130", "-0.6316", "0.3100", "-0.5857", "0.0177"),
    "servo Ca": ("0.1554", "0.0006", "0.6493", "0.0090", "0.1854", "0.0008"),
    "servo B": ("2.1976", "0.0319", "8.8359", "2.3396", "2.2869", "0.0445"),
    "tail CL0": ("0.1219", "0.0227", "0.0403", "0.0084", "0.0623", "0.0087"),
    "tail CL alpha": ("1.1996", "0.0566", "0.9147", "0.2314", "1.1436", "0.0643"),
    "tail CL alpha beta": ("-0.1874", "0.0130", "-0.2215", "0.0090", "-0.2075", "0.0075"),
    "tail CL alpha^3": ("-0.5409", "0.0466", "-0.2231", "0.1279", "-0.4560", "0.0483"),
    "tail CL alpha^2 beta^2": ("0.2657", "0.0341", "0.2261", "0.0324", "0.2454", "0.0235"),
    "tail CD0": ("0.0784", "0.0034", "0.1009", "0.0053", "0.0872", "0.0029"),
    "tail CD alpha^2": ("0.3404", "0.0080", "0.2863", "0.0462", "0.3325", "0.0096"),
    "wing CL0": ("-1.8935", "1.9391", "-2.8556", "0.2325", "-2.7526", "0.2936"),
    "wing CL nu_x": ("0.2333", "0.2107", "3.1314", "0.0669", "2.4330", "0.0718"),
    "wing CL nu_z": ("0.0346", "0.0953", "0.1233", "0.0075", "0.1168", "0.0098"),
    "wing CL omega_y": ("0.2775", "0.1051", "0.3389", "0.0054", "0.3359", "0.0073"),
    "wing CL theta_dot": ("0.0296", "0.0043", "0.0320", "0.0004", "0.0318", "0.0005"),
    "wing CD0": ("-0.0538", "0.0673", "-0.0272", "0.0099", "-0.0306", "0.0122"),
    "wing CD theta_dot": ("-0.0072", "0.0009", "-0.0070", "0.0001", "-0.0070", "0.0001"),
    "wing CD theta^2": ("0.4455", "0.1488", "0.4410", "0.0146", "0.4414", "0.0188"),
}
SERVO_MA = (
    "0.0255",
    "0.0009",
    "0.0425",
    "0.0006",
    "0.0279",
    "0.0001",
)  # printed average not of these numbers


def both(row):
    a, sa, b, sb = map(float, row[:4])
    return [a, b], [sa, sb]


def reach(row, index):
    """How far the average can lie from the printed one when the four inputs are rounded to half a
    unit of the last digit.
    """
    values, errors = both(row)
    base = getattr(pool(values, errors, "inverse_sigma"), index)
    found = 0.0
    for k in range(2):
        for change in (0.5e-4, -0.5e-4):
            moved = (
                [v + change * (j == k) for j, v in enumerate(values)],
                [s + change * (j == k) for j, s in enumerate(errors)],
            )
            found += 0.5 * (abs(getattr(pool(moved[0], errors, "inverse_sigma"), index) - base))
            found += 0.5 * (abs(getattr(pool(values, moved[1], "inverse_sigma"), index) - base))
    return found + 0.5e-4


@pytest.mark.parametrize("name", AVERAGED)
def test_weights_one_over_sigma_give_the_published_averages(name):
    row = AVERAGED[name]
    joined = pool(*both(row), "inverse_sigma")
    assert joined.value == pytest.approx(float(row[4]), abs=reach(row, "value"))
    assert joined.stderr == pytest.approx(float(row[5]), abs=reach(row, "stderr"))


def test_inverse_variance_weights_are_not_what_the_paper_used():
    joined = pool(*both(AVERAGED["tail CL alpha"]))
    assert joined.value == pytest.approx(1.1835, abs=5e-5)
    assert pytest.approx(0.0550, abs=5e-5) == 1 / (1 / 0.0566**2 + 1 / 0.2314**2) ** 0.5
    assert joined.stderr > 0.0550  # Birge ratio 1.2


def test_the_two_rows_of_the_servo_that_do_not_agree_are_seen():
    joined = pool(*both(SERVO_MA), "inverse_sigma")
    assert joined.value == pytest.approx(0.0357, abs=5e-5)
    assert joined.stderr == pytest.approx(0.0005, abs=5e-5)
    assert abs(joined.value - float(SERVO_MA[4])) > 10 * joined.stderr


def test_methods_that_contradict_each_other_are_flagged():
    """Differences in combined standard errors as worked out from the printed numbers: 55, 16, 13,
    3.6, 3.4; servo B only 2.8.
    """
    apart = {"servo Ca": 55, "wing CL nu_x": 13, "tail CD0": 3.6, "tail CL0": 3.4, "servo B": 2.8}
    for name, expected in apart.items():
        joined = pool(*both(AVERAGED[name]))
        assert joined.disagreement == pytest.approx(expected, abs=0.5 if expected > 10 else 0.05)
        assert joined.contradictory == (expected > 3)
    assert pool(*both(SERVO_MA)).disagreement == pytest.approx(16, abs=0.5)
    agreeing = [name for name in AVERAGED if name not in apart]
    assert not any(pool(*both(AVERAGED[name])).contradictory for name in agreeing)


@pytest.mark.parametrize(
    ("window", "order", "gains", "noise"),
    [
        (5, 2, (0.998, 0.991, 0.965, 0.922, 0.864, 0.711), 15.8),
        (7, 2, (0.995, 0.982, 0.928, 0.844, 0.734, 0.473), 9.5),
        (5, 4, (1.000, 1.000, 1.000, 0.999, 0.998, 0.990), 47.5),
        (7, 4, (1.000, 1.000, 0.999, 0.996, 0.988, 0.943), 25.6),
        (9, 4, (1.000, 1.000, 0.997, 0.988, 0.963, 0.843), 16.9),
    ],
)
def test_gains_of_local_polynomials(window, order, gains, noise):
    """To one unit of the last digit: the row (7, 2) prints 0.844 and 9.5 where 0.8435 and 9.449 are
    right.
    """
    assert derivative_gain([0.5, 1, 2, 3, 4, 6], 0.02, window, order) == pytest.approx(
        gains, abs=6e-4
    )
    assert derivative_noise(0.02, window, order) == pytest.approx(noise, abs=0.06)
