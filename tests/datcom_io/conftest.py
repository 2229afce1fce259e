from pathlib import Path

import pytest

DATA = Path(__file__).parents[2] / "data" / "t37" / "datcom"


@pytest.fixture(scope="session")
def t37():
    """Return a reader of the shipped T-37 listings, each read once."""
    import functools

    import datcom_io

    return functools.cache(lambda name: datcom_io.read(DATA / name))


@pytest.fixture
def elevator_lines():
    return (DATA / "t37_elevator.out").read_text().split("\n")
