"""A moment centre that two sources of a blend do not share, by their neutral points."""

import warnings

import numpy as np
import pytest

import aerodb
from aerodb.edit.joined_sources.prior_blending import blend_sources
from flightmech import terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchWarning
from flightmech.units import DEGREE

ALPHA = np.arange(-4.0, 10.0, 2.0) * DEGREE
# what a handbook and a lattice state for a light aircraft: 26 and 32 % behind the reference point
HANDBOOK, LATTICE = (5.7, -1.48), (5.2, -1.66)

# the small databases here lack most terms
pytestmark = pytest.mark.filterwarnings("ignore:.*implausible:flightmech.errors.AeromatchWarning")


def source(program, slopes, centre=0.0, alpha=ALPHA):
    """Return lift and moment of one program, whose moment centre is `centre` chords too far aft."""
    lift, moment = slopes
    CL = 0.3 + lift * alpha
    Cm = 0.02 + moment * alpha + CL * centre
    leaves = {}
    for name, value, relative in (("CL/basic", CL, 0.08), ("Cm/basic", Cm, 0.3)):
        stderr = np.hypot(relative * value, 0.03)
        leaves[name] = terms.make_term(value, {"alpha": alpha}, stderr=stderr, source="datcom")
    box = {"S": 16.0, "cbar": 1.5, "b": 11.0, "x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0}
    return aerodb.make_database(
        leaves, title=program, aircraft="box", force_axes="stability", source=program, **box
    )


def remarks(*databases, **options):
    """Return the sentences of a blend on neutral points."""
    inertia = dict.fromkeys(("Ixx", "Iyy", "Izz"), 1e3)
    craft = Aircraft(
        "box", S=16.0, cbar=1.5, b=11.0, mass=1e3, reference=(0.0, 0.0, 0.0), **inertia
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AeromatchWarning)
        blend_sources(databases, craft, **options)
    return [str(item.message) for item in caught if "neutral point" in str(item.message)]


def test_a_moment_centre_that_is_wrong_by_a_third_of_a_chord_is_named():
    honest = source("Digital DATCOM", HANDBOOK)
    assert remarks(honest, source("AVL", LATTICE)) == []
    (text,) = remarks(honest, source("AVL", LATTICE, centre=-0.3))
    # 1.48/5.7 and 1.66/5.2 + 0.3
    assert "0.26 chords" in text
    assert "Digital DATCOM and 0.62 by AVL" in text
    # the other way it is within the standard errors of the tables
    (text,) = remarks(honest, source("AVL", LATTICE, centre=0.3))
    assert "0.02 by AVL (alpha -2 to 6 deg), 0.24 apart" in text


def test_a_moment_that_is_taken_from_one_source_is_not_compared():
    apart = source("Digital DATCOM", HANDBOOK), source("AVL", LATTICE, centre=-0.3)
    assert remarks(*apart, take={"Cm/basic": "AVL"}) == []


def test_sources_without_a_common_range_of_incidence_are_not_compared():
    short = source("AVL", LATTICE, centre=-0.3, alpha=np.array([6.0, 8.0]) * DEGREE)
    assert remarks(source("Digital DATCOM", HANDBOOK), short) == []
