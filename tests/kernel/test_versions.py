"""The loops over tables for the processor at hand and those for any processor of the platform: the
same bits.
"""

from __future__ import annotations

import ctypes
import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flightmech.simulation.driven_path import DrivenPath, Inertial, Surroundings, Vanes
from flightmech.simulation.kernel import INPUT, PARAMETER, TERM
from flightmech.simulation.kernel_library import SIGNATURES
from flightmech.simulation.normal_sums import NormalSums, Readings, driven_products, driven_series

pytest.importorskip(
    "ziglang", reason="the second library is compiled here, which needs pip install aeromatch[dev]"
)

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def libraries(tmp_path_factory) -> list[ctypes.CDLL]:
    """The kernel as installed, and without the version for AVX2."""
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    build = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(build)
    plain = tmp_path_factory.mktemp("plain") / "kernel.so"
    sources, include = build.kernel_sources(build.LIBRARIES["aeromatch_kernel"].without)
    command = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        *build.FLAGS,
        "-DAM_PLAIN",
        "-fPIC",
        *include,
        *sources,
        "-lm",
        "-o",
        str(plain),
    ]
    subprocess.run(command, check=True)
    (installed,) = (build.OUT / build.native()).glob("aeromatch_kernel.*")
    return [ctypes.CDLL(str(path)) for path in (installed, plain)]


def flown(
    library: ctypes.CDLL, block: bytes, start: dict[str, float], v: np.ndarray
) -> tuple[bytes, bytes]:
    """State after ten seconds, and all contributions at v."""
    pointer, real = ctypes.c_void_p, ctypes.c_double
    for name in ("am_load", "am_new"):
        getattr(library, name).restype = pointer
    model = pointer(library.am_load(block, ctypes.c_size_t(len(block)), None, ctypes.c_size_t(0)))
    sim = pointer(library.am_new(model))
    for name, value in start.items():
        assert (
            library.am_set_parameter(
                sim, library.am_find(model, PARAMETER, name.encode()), real(value)
            )
            == 0
        )
    u = np.zeros(library.am_count(model, INPUT))
    at = u.ctypes.data_as(pointer)
    assert library.am_initialize(sim, real(0.0)) == 0
    assert library.am_step(sim, real(0.0), real(10.0), at, at) == 0
    x, terms = (
        np.zeros(library.am_state_count(model)),
        np.zeros((len(v), library.am_count(model, TERM))),
    )
    assert library.am_get_state(sim, x.ctypes.data_as(pointer)) == 0
    assert (
        library.am_evaluate(
            sim,
            ctypes.c_size_t(len(v)),
            v.ctypes.data_as(pointer),
            None,
            terms.ctypes.data_as(pointer),
        )
        == 0
    )
    library.am_delete(sim)
    library.am_free(model)
    return x.tobytes(), terms.tobytes()


@pytest.mark.nightly
def test_both_versions_fly_and_evaluate_the_same_bits(libraries, sim):
    v = np.random.default_rng(4).uniform(-0.5, 1.5, (200, len(sim.variables)))
    start = {"init.V": 90.0, "init.h": 2000.0, "init.q": 0.02, "init.p": 0.1}
    assert flown(libraries[0], sim.block, start, v) == flown(libraries[1], sim.block, start, v)


def eliminated(library: ctypes.CDLL, monkeypatch) -> list[bytes]:
    """Sums of steps and readings with ten constants, and what their elimination leaves, by one
    library.
    """
    monkeypatch.setattr("flightmech.simulation.normal_sums.load_kernel", lambda: library)
    for name in ("am_add_residuals", "am_eliminate", "am_substitute"):
        getattr(library, name).restype, getattr(library, name).argtypes = SIGNATURES[name]
    rng = np.random.default_rng(6)
    sums = NormalSums(20, 9, 10)
    r, A, B, J = (rng.normal(size=size) for size in ((19, 7), (19, 7, 7), (19, 7, 7), (19, 7, 5)))
    sums.steps(r, np.ones_like(r), A, B, np.array([7, 0, 2, 9, 4]), J)
    r, A, J = (rng.normal(size=size) for size in ((30, 3), (30, 3, 9), (30, 3, 4)))
    sums.readings(
        r, np.ones(3), np.sort(rng.integers(0, 19, 30)), rng.uniform(size=30), A, np.arange(4), J
    )
    around = Surroundings(
        9.81, 3e-6, 0.0, rng.normal(size=3), rng.normal(size=(3, 3)), rng.normal(size=3)
    )
    vanes = Vanes(
        [2, 1],
        rng.normal(size=(2, 3)),
        rng.normal(size=3),
        np.array([0.3, 0.3, 0.4]),
        rng.normal(size=3),
    )
    inertial = Inertial(*rng.normal(size=(3, 20, 3)), np.ones(6), rng.normal(size=3))
    path = DrivenPath(
        inertial,
        rng.normal(size=(20, 9)),
        0.1,
        around,
        (0, 5, 8, 10, 13, 15),
        vanes,
        slow=np.arange(19) == 3,
    )
    sums.path_steps(path, np.ones((19, 9)), np.arange(6))
    sums.D += np.eye(9)
    rest = sums.eliminate()
    found = (
        sums.D,
        sums.O,
        sums.G,
        sums.C,
        sums.gx,
        sums.gc,
        np.array(sums.cost),
        rest.L,
        rest.V[:-1],
        rest.columns,
        rest.border,
    )
    return [
        item.tobytes()
        for item in (
            *found,
            rest.substitute_back(rest.right.copy()),
            rest.substitute_back(rest.right[..., :1].copy()),
        )
    ]


@pytest.mark.nightly
def test_both_versions_sum_and_eliminate_the_same_bits(libraries, monkeypatch):
    assert eliminated(libraries[0], monkeypatch) == eliminated(libraries[1], monkeypatch)


def followed(library: ctypes.CDLL, monkeypatch) -> list[bytes]:
    """A driven path with all its sensitivities, the sums of readings along it, and the noise of its
    instruments, by one library.
    """
    for module in ("driven_path", "normal_sums"):
        monkeypatch.setattr(f"flightmech.simulation.{module}.load_kernel", lambda: library)
    for name in ("am_follow", "am_add_driven", "am_add_noise"):
        getattr(library, name).restype, getattr(library, name).argtypes = SIGNATURES[name]
    rng = np.random.default_rng(7)
    rates, force, before = (
        0.1 * rng.normal(size=(30, 3)),
        rng.normal(size=(30, 3)),
        0.1 * rng.normal(size=(30, 9)),
    )
    vanes = Vanes(
        [2, 1],
        rng.normal(size=(2, 3)),
        rng.normal(size=3),
        np.array([0.3, 0.3, 0.4]),
        rng.normal(size=3),
    )
    around = Surroundings(
        9.81, 3e-6, 0.0, rng.normal(size=3), rng.normal(size=(3, 3)), rng.normal(size=3)
    )
    path = DrivenPath(
        Inertial(rates, force, force, np.ones(6), rng.normal(size=3)),
        before,
        0.02,
        around,
        range(16),
        vanes,
    )
    x, X, pressed, products = (
        np.empty((30, 9)),
        np.empty((30, 9, 25)),
        np.zeros((30, 9, 27)),
        np.zeros((27, 27)),
    )
    path.follow(np.array([0.1, 0.2, 3.0, 50.0, 5.0, 1.0, 800.0, 0.0, 0.0]), x, X)
    k, f, A, J = (
        np.sort(rng.integers(0, 29, 40)),
        rng.uniform(size=40),
        rng.normal(size=(40, 3, 9)),
        rng.normal(size=(40, 3, 3)),
    )
    readings = Readings(rng.normal(size=(40, 3)), k, f, A, np.array([25, -1, 26]), J)
    series = driven_series(X, 27, readings, np.ones(3), pressed)
    path.add_noise(x, np.arange(1.0, 7.0), pressed, products)
    return [
        item.tobytes()
        for item in (x, X, driven_products(X, 27, readings), series, pressed, products)
    ]


@pytest.mark.nightly
def test_both_versions_follow_a_path_to_the_same_bits(libraries, monkeypatch):
    assert followed(libraries[0], monkeypatch) == followed(libraries[1], monkeypatch)
