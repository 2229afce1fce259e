"""Standard errors of the regressions of two flights of the Citation II are the same whatever the
machine rounds.

The list: on the flights of 2018 and 2020 the short period (-3 to 14 s, eight models of forces and
pitching moment), the Dutch roll (-3 to 16 s, four) and the aperiodic roll (-3 to 20 s, five), each
whole, 0.5 s and 1 s shorter at the start and 1 s shorter at the end: 17 models x 4 windows x 2
flights = 136; and three models of the stationary points and three of Dutch roll and roll together,
whole: 12 more.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import flighttest

YEARS = (2018, 2020)
MOTIONS = {
    "short_period": (
        (-3.0, 14.0),
        [
            "CL = 1 + alpha",
            "CL = 1 + alpha + delta_e",
            "CD = 1 + CL**2",
            "CX = 1 + alpha",
            "CZ = 1 + alpha + qhat + delta_e",
            "Cm = 1 + alpha + delta_e",
            "Cm = 1 + alpha + qhat + delta_e",
            "Cm = 1 + alpha + qhat + alphadothat + delta_e",
        ],
    ),
    "dutch_roll": (
        (-3.0, 16.0),
        [
            "CY = 1 + beta + delta_r",
            "Cl = 1 + beta + phat + rhat",
            "Cn = 1 + beta + rhat + delta_r",
            "Cn = 1 + beta + phat + rhat + delta_r",
        ],
    ),
    "aperiodic_roll": (
        (-3.0, 20.0),
        [
            "CY = 1 + beta + phat + rhat",
            "Cl = 1 + phat + delta_a",
            "Cl = 1 + beta + phat + delta_a",
            "Cl = 1 + beta + phat + rhat + delta_a",
            "Cn = 1 + beta + phat + rhat + delta_a",
        ],
    ),
}
SHORTER = ((0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (0.0, 1.0))  # at the start, at the end [s]
STATIONARY = ["CL = 1 + alpha", "CL = 1 + alpha + delta_e", "CD = 1 + CL**2"]
JOINT = [
    "CY = 1 + beta + rhat + delta_r",
    "Cl = 1 + beta + phat + rhat + delta_a + delta_r",
    "Cn = 1 + beta + phat + rhat + delta_a + delta_r",
]


def cases(citation):
    """Yield a name, the data and the model of every fit."""
    for year in YEARS:
        for motion, ((begin, end), models) in MOTIONS.items():
            for late, early in SHORTER:
                data = [citation.coefficients(year, motion, begin + late, end - early)]
                for model in models:
                    yield f"{year} {motion} {late} {early} {model}", data, model
        rest = citation.stationary_parts(year)
        joint = [
            citation.coefficients(year, motion, *MOTIONS[motion][0])
            for motion in ("dutch_roll", "aperiodic_roll")
        ]
        for data, models in ((rest, STATIONARY), (joint, JOINT)):
            for model in models:
                yield f"{year} {len(data)} pieces {model}", data, model


def perturbed(data, model, rng):
    """Return the data with every number that the model reads changed by 1e-12 of itself."""
    names = [model.coefficient, *model.variables]
    return [
        part.assign(
            {name: part[name] * (1.0 + 1e-12 * rng.normal(size=part[name].shape)) for name in names}
        )
        for part in data
    ]


@pytest.mark.slow
@pytest.mark.nightly
def test_a_perturbation_of_1e_12_stays_one(citation):
    """148 fits, three draws each: measured 1e-8 at most, on records whose regressors are collinear
    to a condition of 100.
    """
    spread, number = 0.0, 0
    for number, (_, data, text) in enumerate(cases(citation), 1):
        model = flighttest.RegressionModel.parse(text)
        stderr = flighttest.regress(model, data).estimates["stderr"].values
        for seed in range(3):
            again = flighttest.regress(
                model, perturbed(data, model, np.random.default_rng([number, seed]))
            )
            spread = max(spread, np.abs(again.estimates["stderr"].values / stderr - 1.0).max())
    assert number == 148
    assert spread < 1e-6


@pytest.mark.nightly
def test_standard_errors_of_real_fits_are_those_of_common_sense(citation):
    """Without the fits that a lag window itself cannot judge, the slopes: 0.45 to 2.6 of those of a
    lag window.
    """
    ratios = []
    for _, data, text in cases(citation):
        e = flighttest.regress(flighttest.RegressionModel.parse(text), data).estimates
        ratios.extend((e["stderr"] / e["stderr_window"]).values[1:])
        assert e.attrs["hidden"] < 4.0
    assert min(ratios) > 0.3
    assert max(ratios) < 3.0
    assert 1.0 < np.median(ratios) < 2.0


def child(kernel):
    """Return estimates and standard errors of all fits, from records on, under one kernel of the
    linear algebra.
    """
    script = """
import importlib.util, json, sys
import flighttest

def module(path):
    spec = importlib.util.spec_from_file_location("module", path)
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made

citation, these = map(module, sys.argv[1:])
fits = {}
for name, data, model in these.cases(citation):
    fits[name] = flighttest.regress(flighttest.Model.parse(model), data)
print(json.dumps({name: fit.report() for name, fit in fits.items()}))
"""
    here = Path(__file__)
    run = subprocess.run(
        [sys.executable, "-c", script, str(here.with_name("citation.py")), str(here)],
        env={**os.environ, "OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True, text=True, timeout=600, cwd=here.parents[2],
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def kernels():
    """Kernels of OpenBLAS that this processor can run."""
    flags = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").is_file() else ""
    found = ["Sandybridge"] if " avx " in flags else []
    found += ["Haswell", "Zen"] if " avx2 " in flags else []
    found += ["SkylakeX"] if " avx512vl " in flags else []
    found += ["Cooperlake"] if " avx512_bf16 " in flags else []
    return found + (["SapphireRapids"] if " avx512_bf16 " in flags else [])


@pytest.mark.nightly
@pytest.mark.slow
def test_kernels_of_the_linear_algebra_print_the_same_digits(citation):
    """From the records on: reconstruction, coefficients, regression, report."""
    names = kernels()
    if len(names) < 2:
        pytest.skip("this processor has one kernel")
    first = child(names[0])
    assert len(first) == 148
    for name in names[1:]:
        again = child(name)
        assert [case for case in first if first[case] != again[case]] == []
