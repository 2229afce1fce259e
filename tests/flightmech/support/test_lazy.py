"""Public names of a package from its stub."""

import importlib
import subprocess
import sys

import pytest

from flightmech.support.imports import public_names


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package with a function whose module has the same name, a public module and a stub."""
    folder = tmp_path / "stubbed"
    (folder / "inner").mkdir(parents=True)
    (folder / "__init__.py").write_text(
        "from flightmech.support.imports import attach_stub\n\n__getattr__, __dir__, __all__ "
        "= attach_stub(__name__, __file__)\n"
    )
    (folder / "inner" / "__init__.py").write_text("")
    (folder / "inner" / "double.py").write_text("def double(x):\n    return 2 * x\n")
    (folder / "units.py").write_text("FOOT = 0.3048\n")
    (folder / "__init__.pyi").write_text(
        '"""Names."""\nfrom . import units as units\nfrom .inner.double import double as double\n'
    )
    monkeypatch.syspath_prepend(tmp_path)
    return folder


def test_names_are_loaded_from_the_stub(package):
    stubbed = importlib.import_module("stubbed")
    assert stubbed.__all__ == dir(stubbed) == ["double", "units"]
    assert stubbed.double(3) == 6
    assert stubbed.units.FOOT == 0.3048
    with pytest.raises(
        AttributeError, match="module 'stubbed' has no attribute 'treble'; public are double, units"
    ):
        _ = stubbed.treble


def test_a_missing_stub_is_an_incomplete_installation(package):
    (package / "__init__.pyi").unlink()
    with pytest.raises(ImportError, match=r"__init__.pyi is missing: .*install the package again"):
        public_names(package / "__init__.pyi")


def test_anything_but_relative_imports_is_refused(package):
    (package / "__init__.pyi").write_text("from .units import FOOT as FOOT\nimport os\n")
    with pytest.raises(ValueError, match=r"line 2: allowed are relative imports"):
        public_names(package / "__init__.pyi")


@pytest.mark.slow
def test_a_namespace_inside_another_folder_is_imported_by_a_statement_too():
    code = (
        "from flighttest.signals import time_delay\n"
        "import flighttest, flighttest.combining, aerodb.transform\n"
        "import flighttest.regression.combining as real\n"
        "assert flighttest.combining is real and real.__spec__.name == "
        "'flighttest.regression.combining'\n"
        "assert aerodb.transform is aerodb.edit\n"
        "try:\n    import flighttest.nosuch\nexcept ModuleNotFoundError:\n    print('unknown')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("unknown\n", "")
