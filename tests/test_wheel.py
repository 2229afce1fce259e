"""The wheel is complete: what is in the folders of the packages is in it, and an installation of it
alone works.
"""

import importlib.util
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from shutil import copy, copytree, ignore_patterns

import pytest

from aeromatch.cli.verbs import EXAMPLES

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
PACKAGES = ("flightmech", "datcom_io", "aerodb", "flighttest", "pom", "aeromatch")
MADE = ignore_patterns("__pycache__", "_binaries")  # by Python, and by the build itself

# All public names, every template with its style sheet, and the data that no import reads.
USED = """
import importlib, sys
from pathlib import Path

import xarray as xr

installed = Path(sys.argv[1])
sys.path.insert(0, str(installed))
stubs = sorted(installed.rglob("__init__.pyi"))
for stub in stubs:
    namespace = importlib.import_module(".".join(stub.parent.relative_to(installed).parts))
    assert Path(namespace.__file__).is_relative_to(installed), namespace.__file__
    for name in namespace.__all__:
        getattr(namespace, name)
print(len(stubs))

import flightmech, flighttest, pom
from flighttest.reconstruction.quality.page import read_style_sheet, template_of
from pom.report.page import _SCRIPT, _STATIC, _static
from pom.report.presentation.page_templates import page_templates

assert len(flighttest.readers.shipped_maps()) > 1
assert pom.cases.case_schema()["properties"]
assert len(pom.tolerances.rows.tolerance_rows()) > 50
assert read_style_sheet()
for package in ("reconstruction.quality", "flight_programme.evaluation", "maximum_likelihood"):
    assert template_of(f"flighttest.{package}")
for name in (*_STATIC.values(), *(f"script/{script}.js" for script in _SCRIPT)):
    assert _static(name)
assert page_templates().get_template("report.html")
aircraft = flightmech.Aircraft("a", 17.0, 1.7, 10.3, 2300.0, 10800.0, 8100.0, 15100.0)
from aeromatch.cli.actions.examples import copy_example, example_folder
from aeromatch.cli.verbs import EXAMPLES
from aeromatch.project import read_project

for example in EXAMPLES:
    assert example_folder(example).is_relative_to(installed)
copy_example("c182", installed / "c182")
assert len(read_project(installed / "c182" / "aeromatch.toml").flights) == 8
database = xr.DataTree.from_dict({"/CL/basic": flightmech.terms.make_term(0.3)})
model = flightmech.compile(aircraft, database)
flightmech.write_fmu(model, installed / "model.fmu")
"""


def tree(root: Path) -> set[str]:
    """Return the files below the packages, as they stand in the archive."""
    files = (file for package in PACKAGES for file in (root / package).rglob("*") if file.is_file())
    return {
        file.relative_to(root).as_posix()
        for file in files
        if not {"__pycache__", "_binaries"} & set(file.parts)
    }


def build_wheel(factory, **environment) -> Path:
    """Build the wheel from a copy without what a build leaves behind."""
    if importlib.util.find_spec("hatchling") is None or importlib.util.find_spec("ziglang") is None:
        pytest.skip("needs hatchling and ziglang (pip install aeromatch[dev])")
    source, built = factory.mktemp("source"), factory.mktemp("wheel")
    for folder in (*PACKAGES, "kernel", "data"):
        copytree(ROOT / folder, source / folder, ignore=MADE)
    for file in ("pyproject.toml", "hatch_build.py", "README.md", "LICENSE", ".gitignore"):
        copy(ROOT / file, source)
    (source / "flightmech" / "_binaries").mkdir()
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(built)],
        cwd=source,
        check=True,
        env=os.environ | environment,
    )
    (path,) = built.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel as it is released."""
    return build_wheel(tmp_path_factory)


@pytest.fixture(scope="module")
def wheel_without_kernel(tmp_path_factory):
    """The wheel without the compiled kernel, which takes most of the time of a build."""
    return build_wheel(tmp_path_factory, HATCH_BUILD_NO_HOOKS="true")


def test_wheel_holds_every_file_of_the_packages(wheel_without_kernel):
    names = set(zipfile.ZipFile(wheel_without_kernel).namelist())
    assert tree(ROOT) - names == set()
    endings = {Path(name).suffix for name in tree(ROOT)}
    assert {
        ".pyi",
        ".html",
        ".css",
        ".js",
        ".toml",
        ".csv",
        ".typ",
        ".ttf",
        ".j2",
    } <= endings  # the comparison saw them
    assert {f"{package}/py.typed" for package in PACKAGES} <= names
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in names)
    for example in EXAMPLES:
        here = ROOT / "data" / example
        files = {
            file.relative_to(here).as_posix()
            for file in here.rglob("*")
            if file.is_file() and "__pycache__" not in file.parts
        }
        assert {f"aeromatch/data/{example}/{file}" for file in files} <= names


# platform: tag, and what the library of the platform begins with
WHEELS = {
    "x86_64-linux": ("manylinux_2_17_x86_64", b"\x7fELF"),
    "aarch64-linux": ("manylinux_2_17_aarch64", b"\x7fELF"),
    "x86_64-windows": ("win_amd64", b"MZ"),
    "x86_64-darwin": ("macosx_11_0_x86_64", b"\xcf\xfa\xed\xfe"),
    "aarch64-darwin": ("macosx_11_0_arm64", b"\xcf\xfa\xed\xfe"),
}
# first glibc of the tag
OLDEST_GLIBC = (2, 17)


@pytest.mark.nightly
@pytest.mark.parametrize("platform", WHEELS)
def test_a_wheel_of_each_platform_holds_its_libraries_alone(platform, tmp_path_factory):
    """The wheels of other systems are built and read here, and not run."""
    tag, magic = WHEELS[platform]
    path = build_wheel(tmp_path_factory, AEROMATCH_TARGETS=platform)
    assert path.name.endswith(f"-py3-none-{tag}.whl")
    with zipfile.ZipFile(path) as wheel:
        names = wheel.namelist()
        assert len(names) == len(set(names))
        tops = {name.split("/")[0] for name in names}
        info = {top for top in tops if top.endswith(".dist-info")}
        assert tops - info == set(PACKAGES)
        assert len(info) == 1
        # nothing that a build leaves behind, and no tests
        for name in names:
            assert not {"__pycache__", "tests"} & set(name.split("/")), name
            assert not name.endswith((".pyc", ".orig", ".rej", ".tmp")), name
        libraries = [name for name in names if "/_binaries/" in name]
        assert {name.split("/")[2] for name in libraries} == {platform}
        assert len(libraries) == 2
        for name in libraries:
            content = wheel.read(name)
            assert content.startswith(magic)
            # loaded with ctypes: it has no interface of Python, so every Python 3 loads it
            assert b"PyInit_" not in content
            assert b"libpython" not in content
            versions = re.findall(rb"GLIBC_(\d+)\.(\d+)", content)
            assert all((int(one), int(two)) <= OLDEST_GLIBC for one, two in versions), name


def test_a_target_of_the_build_is_one_platform_or_all(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))
    import hatch_build  # it is a script of the checkout, and belongs to no package

    assert list(hatch_build.TARGETS) == list(WHEELS)
    for platform, (tag, _) in WHEELS.items():
        monkeypatch.setenv("AEROMATCH_TARGETS", platform)
        assert hatch_build.wanted() == [platform]
        assert hatch_build.TARGETS[platform].tag == tag
    monkeypatch.setenv("AEROMATCH_TARGETS", "windows")
    with pytest.raises(SystemExit, match="allowed: native, all, x86_64-linux"):
        hatch_build.wanted()


@pytest.mark.nightly
def test_an_installation_of_the_wheel_alone_works(wheel, tmp_path):
    names = zipfile.ZipFile(wheel).namelist()
    libraries = sorted(Path(name).stem for name in names if "/_binaries/" in name)
    assert libraries == ["aeromatch_fmu", "aeromatch_kernel"]  # those of this machine
    zipfile.ZipFile(wheel).extractall(tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", USED, str(tmp_path)], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == sum(
        1 for package in PACKAGES for _ in (ROOT / package).rglob("__init__.pyi")
    )
    assert (tmp_path / "model.fmu").is_file()
