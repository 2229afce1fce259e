"""The diagnosis of Citation II motions stops early without changing what it states, and does not
depend on rounding.

The final model is DATCOM's with the tables found from flight (`test_citation_match`).
"""

import numpy as np
import pytest

import aerodb
import pom
from pom.diagnosis import screening

from .test_citation_match import CASES, HELD, YEAR, case_file

TINY = 1e-12  # relative


@pytest.fixture(scope="module")
def databases(citation, ce500_db):
    prior = citation.similar(ce500_db)
    return prior, aerodb.replace_terms(
        prior, aerodb.tabulate(citation.fits_of(2018), prior, held=HELD)
    )


def kept(table):
    """Return what a reader takes from a diagnosis: rows of the stages that do not depend on which
    terms were flown alone.
    """
    stages = ["prior", "final", "group", "sequence", "share"]
    return table[table["stage"].isin(stages)].set_index(["stage", "term"])


def demand_same(one, other, atol):
    """Demand the same rows in the same order, the same verdicts, and `explained` within `atol`;
    return the largest difference.
    """
    assert list(one.index) == list(other.index)
    assert list(one["verdict"]) == list(other["verdict"])
    worst = 0.0
    for name in (column for column in one if str(column).endswith("explained")):
        a, b = one[name].to_numpy(float), other[name].to_numpy(float)
        assert (np.isnan(a) == np.isnan(b)).all()
        worst = max(worst, float(np.nanmax(np.abs(a - b), initial=0.0)))
    assert worst <= atol
    return worst


@pytest.mark.slow
@pytest.mark.parametrize("motion", CASES)
@pytest.mark.nightly
def test_early_stop_and_rounding(citation, databases, motion, tmp_path, monkeypatch):
    case = pom.read_case(case_file(citation, motion, tmp_path))
    path = citation.path(YEAR, motion, *CASES[motion][1])
    table = pom.diagnose(case, *databases, citation.aircraft(), path)
    idle = table[(table["stage"] == "idle") & (table["term"] != "")]
    shaken = path.states.copy()
    rng = np.random.default_rng(1)
    for name in shaken.data_vars:
        if shaken[name].dtype == float:
            shaken[name] = shaken[name] * (1.0 + TINY * rng.standard_normal(shaken[name].shape))
    again = pom.diagnose(case, *databases, citation.aircraft(), shaken)
    demand_same(
        kept(table), kept(pom.diagnose(case, *databases, citation.aircraft(), path.states)), 0.0
    )
    rounding = demand_same(kept(table), kept(again), 1e-3)
    monkeypatch.setattr(screening, "LEAST_MOVED", 0.0)  # every term is flown
    every = pom.diagnose(case, *databases, citation.aircraft(), path)
    assert "idle" not in set(every["stage"])
    early = demand_same(kept(table), kept(every), 0.02)
    print(motion, len(idle), "idle", "rounding", rounding, "early", early)
