"""Examples in the docstrings of the packages.

They are collected here and not by ``--doctest-modules``, which imports every module of the product
and of the tests a second time in each process of a run.
"""

import doctest
from importlib import import_module

import pytest
from import_graph import modules

EXAMPLES = [name for name, file in modules().items() if ">>> " in file.read_text(encoding="utf-8")]


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_of_a_module_print_what_they_show(name):
    found = [test for test in doctest.DocTestFinder().find(import_module(name)) if test.examples]
    assert found
    runner = doctest.DocTestRunner()
    for test in found:
        runner.run(test)
    assert runner.failures == 0
