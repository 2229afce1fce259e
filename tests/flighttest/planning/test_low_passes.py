"""Low passes of a catalogue: one manoeuvre, and one fit, per height."""

import pytest

from flighttest.flight_programme.planning.catalogue import Catalogue
from flighttest.flight_programme.planning.low_passes import split_heights

PASS = {"name": "low pass", "kind": "low_pass", "amplitude": "1 deg", "duration": "10 s"}
FIT = {"name": "ground", "manoeuvres": ["low pass"], "models": ["CL = 1 + alpha"]}
CONTENT = {
    "condition": [{"name": "runway", "setup": "60 s", "fixed": {"V": "98 kt", "h_agl": "20 m"}}],
    "manoeuvre": [{**PASS, "heights": [0.2, 0.8]}],
    "fit": [FIT],
    "wanted": [{"term": "Cm/ground", "ratio": 0.5}],
}


def test_every_height_is_a_manoeuvre_with_its_own_fit():
    catalogue = Catalogue.model_validate(CONTENT)
    assert [m.name for m in catalogue.manoeuvre] == ["low pass, 0.2 span", "low pass, 0.8 span"]
    assert [m.height for m in catalogue.manoeuvre] == [0.2, 0.8]
    fits = {fit.name: fit.manoeuvres for fit in catalogue.fit}
    assert fits == {
        "ground, 0.2 span": ("low pass, 0.2 span",),
        "ground, 0.8 span": ("low pass, 0.8 span",),
    }
    assert split_heights(split_heights({"manoeuvre": []})) == {"manoeuvre": [], "fit": None}


@pytest.mark.parametrize(
    "heights", [None, [], [0.2, 0.2], [-0.1], ["low"], 0.2, [float("inf")], [True]]
)
def test_heights_that_are_none(heights):
    content = {**CONTENT, "manoeuvre": [{**PASS, "heights": heights}]}
    with pytest.raises(ValueError, match=r"heights in spans, such as \[0.2, 0.4, 0.8\]"):
        Catalogue.model_validate(content)


def test_a_catalogue_that_wants_nothing_or_a_row_that_is_not_flown():
    with pytest.raises(ValueError, match="nothing is wanted"):
        Catalogue.model_validate({**CONTENT, "wanted": []})
    row = {"row": "2.e.1", "condition": "runway", "manoeuvre": "landing", "ratio": 0.5}
    with pytest.raises(ValueError, match=r"there are runway, low pass, 0\.2 span"):
        Catalogue.model_validate({**CONTENT, "wanted_row": [row]})
