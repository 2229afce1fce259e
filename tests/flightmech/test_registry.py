"""The vocabulary is the one list of quantities: other modules look facts up in it."""

import ast
from pathlib import Path

import pytest

from flightmech.names import IMPLICIT, REDUCED_RATES, VOCABULARY

ROOT = Path(__file__).parents[2]
PACKAGES = ("flightmech", "datcom_io", "aerodb", "flighttest", "pom", "aeromatch")
# modules that list reduced rates for a reason of their own
OWN_LISTS = {
    "flightmech/names.py": "the vocabulary",
    "aerodb/comparison/conditions.py": "range of each variable in a comparison",
    "aerodb/estimators/effects.py": "coefficients with a derivative for each variable",
    "aerodb/exchange/daveml/export_checks.py": "range of each variable in a check case",
    "aerodb/exchange/jsbsim/properties.py": "property of JSBSim for each variable",
    "aerodb/prior/prior_errors.py": "standard error of each derivative of DATCOM",
    "aerodb/store/evaluation.py": "range of each variable that is not suspect",
    "pom/report/presentation/term_words.py": "symbol of each variable on a page",
}


def listed_rates(file: Path) -> int:
    """Return the largest number of reduced rates in one display of a module."""
    text = file.read_text(encoding="utf-8")
    # most modules are decided without a syntax tree
    if sum(f'"{name}"' in text for name in REDUCED_RATES) <= 3:
        return 0
    most = 0
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Dict):
            items = node.keys
        elif isinstance(node, ast.Tuple | ast.List | ast.Set):
            items = node.elts
        else:
            continue
        names = {item.value for item in items if isinstance(item, ast.Constant)}
        most = max(most, len(names & set(REDUCED_RATES)))
    return most


@pytest.mark.slow
def test_no_other_module_lists_the_reduced_rates():
    files = [file for package in PACKAGES for file in (ROOT / package).rglob("*.py")]
    lists = {file.relative_to(ROOT).as_posix() for file in files if listed_rates(file) > 3}
    assert lists == set(OWN_LISTS)


@pytest.mark.parametrize("name", REDUCED_RATES)
def test_reduced_rates_are_without_unit(name):
    rate, length = REDUCED_RATES[name]
    assert VOCABULARY[name].units == "1"
    assert VOCABULARY[rate].units == "rad s-1"
    assert VOCABULARY[length].units == "m"


def test_implicit_variables_are_in_the_vocabulary():
    assert set(IMPLICIT) <= set(VOCABULARY)
