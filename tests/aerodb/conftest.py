"""A small database written by hand, a small DATCOM case, and the T-37 listings where they are at
hand.
"""

import dataclasses
import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import aerodb
from flightmech import terms
from flightmech.units import FOOT

CORPUS = Path(__file__).parents[3] / "shared" / "data" / "datcom"
T37 = Path(__file__).parents[2] / "data" / "t37" / "datcom"


@dataclass(frozen=True)
class TableCraft:
    """The part of an aircraft that a database needs; the T-37 by default."""

    name: str = "T-37"
    S: float = 182.0 * FOOT**2
    cbar: float = 5.47 * FOOT
    b: float = 33.83 * FOOT
    reference: tuple[float, float, float] = (-9.88 * FOOT, 0.0, 0.0)


@pytest.fixture(scope="session")
def craft():
    return TableCraft()


@pytest.fixture
def root():
    return {
        "title": "small database",
        "aircraft": "test",
        "S": 16.9,
        "cbar": 1.667,
        "b": 10.31,
        "x_ref": -3.0,
        "y_ref": 0.0,
        "z_ref": 0.0,
        "force_axes": "stability",
        "source": "by hand",
        "history": "by hand",
        "absent": "CL/gear CY/rhat",
    }


@pytest.fixture
def small_terms():
    alpha = np.radians([-8.0, 0.0, 8.0, 16.0])
    mach = [0.2, 0.4]
    CL = 0.2 + np.outer([5.0, 5.4], alpha)
    return {
        "CL/basic": terms.make_term(
            CL, {"mach": mach, "alpha": alpha}, stderr=0.05, source="datcom", comment="clean"
        ),
        "CL/qhat": terms.make_term(
            [8.0, 8.4], {"mach": mach}, ["qhat"], stderr=[2.0, 2.1], source="datcom"
        ),
        "CL/flap": terms.make_term(
            [0.0, 0.2, 0.36],
            {"delta_f": np.radians([0, 20, 40])},
            stderr=[0.0, 0.04, 0.07],
            source="datcom",
        ),
        "Cm/qhat": terms.make_term(-17.0, regressors=["qhat"], source="datcom"),
    }


@pytest.fixture
def small(small_terms, root):
    return aerodb.make_database(small_terms, **root)


@pytest.fixture(scope="session")
def make_case():
    """Return a maker of clean case trees of a straightforward aeroplane, one that algebra can
    follow.
    """

    def make(S=16.0, cbar=1.6, b=10.0, x_cg=3.0, z_cg=0.0, **static):
        alpha = np.radians(np.arange(-8.0, 17.0, 2.0))
        mach, h = (grid.ravel() for grid in np.meshgrid([0.2, 0.4], [0.0, 3000.0]))
        over = ("condition", "alpha")
        one = np.ones((4, alpha.size))
        tables = {
            "CL": 0.2 + 5.0 * alpha,
            "CD": 0.02 + 0.0 * alpha,
            "Cm": 0.05 - 0.8 * alpha,
            **static,
        }
        tables |= {"CY_beta": -0.4, "Cn_beta": 0.06, "Cl_beta": -0.05 - 0.2 * alpha}
        rates = {"CL_qhat": 8.0, "Cm_qhat": -17.0, "CL_alphadothat": 3.0, "Cm_alphadothat": -10.0}
        rates |= {
            "Cl_phat": -0.46,
            "CY_phat": -0.06,
            "Cn_phat": -0.02,
            "Cn_rhat": -0.09,
            "Cl_rhat": 0.08,
        }
        coords = {
            "condition": np.arange(4),
            "alpha": alpha,
            "mach": ("condition", mach),
            "h": ("condition", h),
        }
        leaves = {
            name: xr.Dataset({key: (over, one * item) for key, item in group.items()}, coords)
            for name, group in (("static", tables), ("dynamic", rates))
        }
        attributes = {
            "S": S,
            "cbar": cbar,
            "b": b,
            "x_cg": x_cg,
            "z_cg": z_cg,
            "case": "BY HAND",
            "file": "by_hand.out",
        }
        return xr.DataTree.from_dict({"/": xr.Dataset(attrs=attributes), **leaves})

    return make


@pytest.fixture(scope="session")
def corpus():
    """Return a reader of third-party listings by name, and by case; tests without them are
    skipped.
    """
    if not CORPUS.is_dir():
        pytest.skip("needs the corpus ../shared/data/datcom")
    import datcom_io

    parsed = functools.cache(datcom_io.read)  # tests change no listing

    def read(name, case=None, build=""):
        listing = parsed(CORPUS / name / f"{name}{build}.out")
        return listing if case is None else listing[case]

    return read


@pytest.fixture(scope="session")
def jet(craft):
    """Return the Citation-500-like jet of the corpus."""
    return dataclasses.replace(
        craft, name="Ce-500-like", S=24.2, cbar=2.022, b=13.36, reference=(-6.3, 0.0, 0.15)
    )


@pytest.fixture(scope="session")
def t37_folder():
    """Return the folder of the T-37 listings."""
    return T37


@pytest.fixture(scope="session")
def t37(t37_folder):
    """Return every listing of the T-37 by name."""
    import datcom_io

    names = (
        "clean",
        "build",
        "flaps",
        "elevator",
        "aileron",
        "ground",
        "ground_flap",
        "ground_elevator",
    )
    found = {name: datcom_io.read(t37_folder / f"t37_{name}.out") for name in names}
    found["elevator_one_by_one"] = datcom_io.read(t37_folder / "t37_elevator_one_by_one.pdas.out")
    found["ground_flap_one_by_one"] = datcom_io.read(
        t37_folder / "t37_ground_flap_one_by_one.pdas.out"
    )
    return found


@pytest.fixture(scope="session")
def t37_db(t37, craft):
    """Return the whole database of the T-37; the drift of the flap loop is warned about."""
    with pytest.warns(Warning, match="flaps: D\\(CM\\) comes from a loop"):
        return aerodb.from_datcom(
            craft,
            clean=t37["clean"],
            flaps=t37["flaps"],
            elevator=t37["elevator_one_by_one"],
            aileron=t37["aileron"],
            ground=t37["ground"],
            ground_flap=t37["ground_flap_one_by_one"],
        )
