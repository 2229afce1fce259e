import numpy as np
import pytest

from flightmech.errors import IdentificationError
from flighttest.records.signals.fourier import (
    adjoint_fourier,
    finite_fourier,
    harmonics,
    remove_straight_line,
)

STEP, T = 0.02, 10.0
TIME = np.arange(0.0, T + STEP / 2, STEP)


def decaying(t):
    return np.exp((-0.3 + 2j) * t).real + 0.1 * t


def exact(f):
    """The integral of `decaying`, by hand."""
    w = 2 * np.pi * f

    def exponential(s):
        return (np.exp((s - 1j * w) * T) - 1) / (s - 1j * w)

    ramp = 0.1 * (np.exp(-1j * w * T) * (1 + 1j * w * T) - 1) / w**2
    return 0.5 * (exponential(-0.3 + 2j) + exponential(-0.3 - 2j)) + ramp


@pytest.mark.parametrize("f", [0.02, 0.1, 0.5, 0.79, 0.81, 1.0, 3.0])
def test_a_signal_that_does_not_end_where_it_began_is_transformed_exactly(f):
    """Both sides of 0.796 Hz, where series and closed form of the corrections meet.  Published:
    1e-8 to 4e-8 of the transform where the plain sum has 0.2 % at 0.02 Hz and 37 % at 3 Hz; the
    error of a cubic grows with the frequency.
    """
    error = abs(finite_fourier(decaying(TIME), STEP, [f])[0] - exact(f))
    assert error < 1e-7 * abs(exact(0.02))
    plain = abs(STEP * np.exp(-2j * np.pi * f * TIME) @ decaying(TIME) - exact(f))
    assert error < 1e-3 * plain


def test_chirp_z_and_plain_sums_agree():
    uniform = np.linspace(0.1, 3.0, 30)
    chirp = finite_fourier(np.stack([decaying(TIME), TIME**2], axis=1), STEP, uniform)
    sums = finite_fourier(np.stack([decaying(TIME), TIME**2], axis=1), STEP, [*uniform, 3.7])[:-1]
    np.testing.assert_allclose(chirp, sums, rtol=1e-10, atol=1e-12)
    assert chirp.shape == (30, 2)


def test_the_derivative_rule_holds_with_its_end_terms():
    f = harmonics(T, 0.1, 2.0)
    x, slope = np.sin(1.3 * TIME), 1.3 * np.cos(1.3 * TIME)
    turn = np.exp(-2j * np.pi * f * T)
    expected = 2j * np.pi * f * finite_fourier(x, STEP, f) + x[-1] * turn - x[0]
    np.testing.assert_allclose(finite_fourier(slope, STEP, f), expected, atol=1e-7)


def test_the_adjoint_is_that_of_the_matrix():
    f = np.linspace(0.1, 3.0, 7)
    F = finite_fourier(np.eye(60), STEP, f)
    values = np.random.default_rng(0).normal(size=(7, 2, 2)) @ np.array([1.0, 1j])
    np.testing.assert_allclose(
        adjoint_fourier(values, STEP, f, 60), (F.conj().T @ values).real, atol=1e-14
    )


def test_detrending_takes_out_the_line_and_nothing_else():
    line = 3.0 - 0.2 * TIME
    assert abs(remove_straight_line(line)).max() < 1e-13
    once = remove_straight_line(decaying(TIME) + line)
    np.testing.assert_allclose(remove_straight_line(once), once, atol=1e-13)
    np.testing.assert_allclose(once, remove_straight_line(decaying(TIME)), atol=1e-13)


def test_bands_that_cannot_be_worked_in_are_refused():
    np.testing.assert_allclose(harmonics(20.0, 0.1, 0.3), [0.1, 0.15, 0.2, 0.25, 0.3])
    with pytest.raises(IdentificationError, match=r"band 0 ... 1 Hz; expected 0 < low < high"):
        harmonics(20.0, 0.0, 1.0)
    with pytest.raises(IdentificationError, match=r"no multiple of 1/2 s in 0.6 ... 0.9 Hz"):
        harmonics(2.0, 0.6, 0.9)
    with pytest.raises(IdentificationError, match="30 Hz is beyond half the sampling rate, 25 Hz"):
        finite_fourier(TIME, STEP, [30.0])
    with pytest.raises(
        IdentificationError, match="7 samples for a Fourier transform; 8 are needed"
    ):
        finite_fourier(TIME[:7], STEP, [1.0])
