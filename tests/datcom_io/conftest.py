import functools
from pathlib import Path

import pytest

DATA = Path(__file__).parents[2] / "data" / "t37" / "datcom"
SHARED = Path(__file__).parents[2] / ".." / "shared" / "data" / "datcom"


@pytest.fixture(scope="session")
def t37():
    """Return a reader of the shipped T-37 listings, each read once."""
    import datcom_io

    return functools.cache(lambda name: datcom_io.read(DATA / name))


@pytest.fixture
def elevator_lines():
    return (DATA / "t37_elevator.out").read_text().split("\n")


@pytest.fixture(scope="session")
def corpus_lines():
    """Return a reader of the corpus next to the checkout, as lines; build B is ``.pdas.out``."""
    if not SHARED.is_dir():
        pytest.skip("the corpus ../shared/data/datcom is not there")
    return functools.cache(
        lambda name, end=".out": (
            (SHARED / name / f"{name}{end}").read_text(encoding="latin-1").split("\n")
        )
    )


@pytest.fixture(scope="session")
def corpus(corpus_lines):
    """Return a reader of the corpus next to the checkout, each listing read once."""
    import datcom_io

    return functools.cache(lambda name, end=".out": datcom_io.read(corpus_lines(name, end)))
