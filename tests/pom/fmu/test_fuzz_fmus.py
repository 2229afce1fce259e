"""Harmed FMUs are refused with an error of ours, or fly, fail, hang or crash in a process of their
own; see ``tests/fuzz/README.md``.
"""

import importlib.util
import itertools
import os
from collections import Counter
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="forks a process for every input")


@pytest.mark.slow
@pytest.mark.nightly
def test_every_harmed_fmu_is_refused_or_answered(toy, tmp_path):
    spec = importlib.util.spec_from_file_location(
        "fuzz_fmu", Path(__file__).parents[2] / "fuzz" / "fuzz_fmu.py"
    )
    fuzz = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(fuzz)
    bases = [fuzz.content_of(toy(kind)) for kind in ("lag", "nan")]
    count = int(os.environ.get("AEROMATCH_FUZZ", "300"))
    found = Counter(
        fuzz.one_input(content, tmp_path)
        for content in itertools.islice(fuzz.inputs(bases, 16), count)
    )
    assert found.total() == count
    assert min(found["refused"], found["flown"]) > count / 10, (
        "both must have been met, or nothing was tested"
    )
