"""Numbers of a CSV file are those of ``%.9g``, to the letter."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from pom.report.csv_lines import csv_lines

EDGES = [
    0.0,
    -0.0,
    math.nan,
    math.inf,
    -math.inf,
    5e-324,
    1.7e308,
    1e9,
    999999999.5,
    999999999.4999,
    99999999.95,
    1e-5,
    9.999999995e-5,
]
EDGES += [
    9.9999999949e-5,
    1e-100,
    9.999999996e99,
    1e22,
    1e23,
    123456789.5,
    12345678.95,
    0.5,
    1e-4,
    -1e-4,
]


def as_python_writes(columns):
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return "".join(
        ",".join("" if math.isnan(x) else f"{x:.9g}" for x in row) + "\n" for row in rows
    )


def test_numbers_of_every_size():
    rng = np.random.default_rng(1)
    count = 3000
    exponents = np.linspace(-320.0, 307.0, count)
    columns = [
        rng.normal(size=count) * 10.0**exponents,
        np.round(rng.normal(size=count), 3),
        rng.integers(0, 10**11, count)
        * 0.5 ** rng.integers(0, 12, count),  # half way between two texts among them
        np.nextafter(10.0 ** np.round(exponents), np.resize([-np.inf, 0.0, np.inf], count)),
        np.resize(EDGES, count),
        np.full(count, -0.0),
        np.full(count, np.nan),
        np.arange(count) * 0.02,
    ]
    assert "".join(csv_lines(columns)) == as_python_writes(columns)


@given(
    arrays.arrays(
        float, st.tuples(st.integers(1, 4), st.integers(0, 9)), elements=st.floats(width=64)
    )
)
def test_any_numbers(columns):
    assert "".join(csv_lines([*columns])) == as_python_writes([*columns])


@pytest.mark.parametrize("digits", [1e9 - 1.5, 1e8 + 0.5, 2.5e8 + 1.5])
@pytest.mark.parametrize("power", range(-12, 13))
def test_ties_are_rounded_as_the_double_lies(digits, power):
    value = float(f"{digits}e{power}")
    columns = [np.array([value, np.nextafter(value, 0.0), np.nextafter(value, np.inf), -value])]
    assert "".join(csv_lines(columns)) == as_python_writes(columns)
