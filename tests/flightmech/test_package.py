"""The public page: lazy and complete."""

from __future__ import annotations

import subprocess
import sys

import pytest

import flightmech


def test_import_is_fast():
    code = (
        "import sys, flightmech; print([m for m in ('numpy', 'scipy', 'xarray', 'pydantic', "
        "'ctypes') if m in sys.modules])"
    )
    found = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=flightmech.__path__[0] + "/..",
    )
    assert found.stdout.strip() == "[]"


def test_all_public_names_resolve():
    for name in flightmech.__all__:
        assert getattr(flightmech, name) is not None
    assert set(flightmech.__all__) <= set(dir(flightmech))


def test_unknown_names_state_what_there_is():
    with pytest.raises(AttributeError, match="has no attribute 'simulat'; public are Aircraft"):
        _ = flightmech.simulat
