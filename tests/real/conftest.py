"""The listings of the Citation-500-like aeroplane and the flights of the Citation II, from
../shared.
"""

import importlib.util
from pathlib import Path

import pytest

import aerodb
import datcom_io
import flightmech
from flightmech.errors import AeromatchWarning

HERE = Path(__file__).parent
CORPUS = HERE.parents[1] / ".." / "shared" / "data" / "datcom"
ROLES = ("clean", "flaps", "elevator", "aileron", "ground")


@pytest.fixture(scope="session")
def ce500():
    """The aircraft of the listings."""
    return flightmech.read_aircraft(HERE / "maps" / "ce500.toml")


@pytest.fixture(scope="session")
def listings():
    if not CORPUS.is_dir():
        pytest.skip("the corpus ../shared/data/datcom is not there")
    return {role: datcom_io.read(CORPUS / f"ce500_{role}" / f"ce500_{role}.out") for role in ROLES}


@pytest.fixture(scope="session")
def ce500_db(ce500, listings):
    """The a-priori database at sea level: slotted flaps (first case of two), ground pages without
    elevator (first case of two).
    """
    given = {
        role: listing[0] if role in ("flaps", "ground") else listing
        for role, listing in listings.items()
    }
    with pytest.warns(AeromatchWarning, match="D\\(CM\\) comes from a loop"):
        return aerodb.from_datcom(ce500, **given, altitude=0.0)


@pytest.fixture(scope="session")
def citation():
    """The module ``citation.py`` next to this file."""
    spec = importlib.util.spec_from_file_location("real_citation", HERE / "citation.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    if not module.FLIGHTS.is_dir():
        pytest.skip(module.ABSENT)
    return module
