"""The page "How a step is computed" against the sources: files, functions, the order of calls, and
its example, which is made in a copy of the sources, compiled and flown.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
KERNEL = ROOT / "kernel" / "src"
PAGE = (ROOT / "docs/explanation/simulation/how-a-step-is-computed.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (?:\d \| )?`(\w+)\(\)` \| (?:`([\w/.]+)` \| )?", PAGE, re.M)
SOURCES = {path.relative_to(KERNEL).as_posix(): path.read_text() for path in KERNEL.rglob("*.[ch]")}


def body(function: str, file: str) -> str:
    """Return the definition of a function."""
    found = re.search(rf"^[\w ]*\b{function}\([^;]*?\{{.*?^\}}", SOURCES[file], re.M | re.S)
    assert found, f"{file} does not define {function}"
    return found.group()


def in_order(text: str, functions: list[str]) -> bool:
    """Whether a text calls the functions one after the other."""
    at = [text.find(f"{function}(") for function in functions]
    return min(at) >= 0 and at == sorted(at)


@pytest.mark.slow
def test_functions_stand_in_the_files_that_the_page_names():
    named = [(function, file) for function, file in ROWS if file]
    assert len(named) == 10
    for function, file in named:
        body(function, file)
    everything = "\n".join(SOURCES.values())
    for function in set(re.findall(r"`(\w+)\(\)`", PAGE)):
        assert re.search(rf"\b{function}\(", everything), function


def test_a_derivative_has_the_order_of_the_page():
    steps = [function for function, file in ROWS if not file]
    assert steps[0] == "set_flight_condition"
    assert len(steps) == 7
    assert in_order(body("derivative", "flight/sixdof.c"), steps)
    memory = ["weather_advance", "engine_advance", "control_advance"]
    assert in_order(body("advance_memory", "flight/one_step.c"), memory)
    step = ["HOOK(advance_parts)", "HOOK(first_slope)", "slope", "combine"]
    assert in_order(body("runge_kutta", "flight/runge_kutta.h"), step)


def test_names_of_the_page_exist():
    names = set(re.findall(r"\b(?:STAGE|[PUXATYG])_[A-Z0-9_]+\b", PAGE))
    names -= {"P_CONTACT_ROLLING_SQUARE"}  # of the example
    assert len(names) > 12
    everything = "\n".join(SOURCES.values())
    assert [name for name in sorted(names) if not re.search(rf"\b{name}\b", everything)] == []


def changes() -> dict[str, list[tuple[str, str]]]:
    """Return what the example replaces, by file: the lines before and after."""
    found: dict[str, list[tuple[str, str]]] = {}
    for block in re.findall(r"^```text\n(.*?)^```$", PAGE, re.M | re.S):
        file, rest = block.split("\n", 1)
        for hunk in rest.split("...\n"):
            lines = hunk.splitlines()
            before = [line[2:] for line in lines if not line.startswith("+")]
            after = [line[2:] for line in lines if not line.startswith("-")]
            found.setdefault(file, []).append(("\n".join(before), "\n".join(after)))
    return found


def changed(text: str, before: str, after: str) -> str:
    """Return a text with some lines replaced, which stand there once."""
    assert text.count(before) == 1, before
    return text.replace(before, after)


def test_the_example_fits_the_sources():
    assert len(changes()) == 6
    for file, replaced in changes().items():
        text = (ROOT / file).read_text(encoding="utf-8")
        for before, after in replaced:
            assert changed(text, before, after) != text, file


FLIGHT = """
import sys
sys.path.insert(0, sys.argv[1])
import numpy as np, xarray as xr
import flightmech
from flightmech.aircraft.landing_gear import Contact, LandingGear
from flightmech.terms import make_term

assert flightmech.__file__.startswith(sys.argv[1])
leg = {"damping": 8e3, "tyre_stiffness": 400e3, "side_stiffness": 150e3, "rolling": 0.02}
nose = leg | {"stiffness": 40e3, "cornering_stiffness": 15e3, "cornering_load": 5e3}
main = leg | {"stiffness": 90e3, "cornering_stiffness": 45e3, "cornering_load": 14e3}


def speed(**term):
    contacts = (
        Contact("nose", (1.564, 0.0, 0.759), **nose, **term),
        Contact("left", (-0.17, -0.805, 0.759), **main, **term),
        Contact("right", (-0.17, 0.805, 0.759), **main, **term),
    )
    craft = flightmech.Aircraft(
        "car", 17.0, 1.67, 10.3, 2150.0, 10826.0, 8135.0, 15162.0, cg=(0.0, 0.0, 0.2235),
        gear=LandingGear(contacts),
    )
    model = flightmech.compile(craft, xr.DataTree.from_dict({"/CD/basic": make_term(0.0)}))
    record = xr.Dataset({"gear": ("time", np.ones(401))}, {"time": 0.02 * np.arange(401)})
    start = {"mode.earth": 0.0, "init.h": 0.415, "init.theta": 0.0}
    runs = {"init.V": np.full(8, 40.0)}
    flown = [
        flightmech.simulate_batch(model, record, runs, start, lanes=lanes) for lanes in (1, 4, 8)
    ]
    bits = {b"".join(found[name].values.tobytes() for name in model.outputs) for found in flown}
    assert len(bits) == 1
    return float(flown[0]["V"].values[0, -1])


print(speed(), speed(rolling_square=2e-5))
"""


@pytest.mark.slow
@pytest.mark.nightly
def test_the_example_flies_as_the_page_states(tmp_path):
    pytest.importorskip("ziglang", reason="the changed kernel is compiled here")
    ignore = shutil.ignore_patterns("__pycache__", "_binaries")
    for folder in ("kernel", "flightmech"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=ignore)
    shutil.copy(ROOT / "hatch_build.py", tmp_path)
    (tmp_path / "flightmech" / "_binaries").mkdir()
    for file, replaced in changes().items():
        path = tmp_path / file
        for before, after in replaced:
            path.write_text(changed(path.read_text(encoding="utf-8"), before, after))
    subprocess.run([sys.executable, "hatch_build.py"], cwd=tmp_path, check=True)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-P", "-c", FLIGHT, str(tmp_path)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    plain, square = (float(word) for word in done.stdout.split())
    # v' = -a and v' = -(a + b v^2) from 40 m/s; the start dips the legs and pitches the aircraft
    assert plain == pytest.approx(40.0 - 0.02 * 9.80665 * 8.0, abs=2e-3)
    assert square == pytest.approx(36.15839, abs=2e-3)
