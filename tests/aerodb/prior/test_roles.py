"""Roles found from the listings of a light aircraft in the layouts that listings come in
(tests/aerodb/listings), and of the T-37.
"""

import dataclasses
import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import aerodb
import datcom_io
from aerodb.cli.group import db as group
from aerodb.prior.build import require_device_on_surface
from aerodb.prior.roles import assign_roles, by_role
from aerodb.prior.sources import collect_source
from datcom_io.decks.deck_file import deck_text
from flightmech.errors import AeromatchWarning, SchemaError
from flightmech.units import DEGREE, FOOT

LISTINGS = Path(__file__).parents[1] / "listings"
AIRCRAFT = """
name = "Light single"
S = "160 ft2"
cbar = "4.9 ft"
b = "33 ft"
mass = 1000.0
Ixx = 1300.0
Iyy = 1800.0
Izz = 2700.0
"""
REFERENCE = 'reference = ["-7.2 ft", 0.0, "-0.1 ft"]\n'  # XCG 7.2, ZCG 0.1 of the decks
CT = {"jet": 0.12, "prop": 0.10}  # NENGS x THSTC of the decks


@pytest.fixture(scope="module")
def read():
    """Return a reader of the listings by name, each read once."""
    found = {path.stem: datcom_io.read(path) for path in LISTINGS.glob("*.out")}
    return found.__getitem__


@pytest.fixture(scope="module")
def light(craft):
    """Return the light aircraft as the decks have it."""
    lengths = {"cbar": 4.9 * FOOT, "b": 33.0 * FOOT, "reference": (-7.2 * FOOT, 0.0, -0.1 * FOOT)}
    return dataclasses.replace(craft, name="Light single", S=160.0 * FOOT**2, **lengths)


@pytest.fixture
def aircraft(tmp_path):
    """Return the file of the light aircraft."""
    file = tmp_path / "aircraft.toml"
    file.write_text(REFERENCE + AIRCRAFT)
    return file


def roles(*listings):
    return [item.roles for item in assign_roles(listings)]


def build(*arguments):
    return CliRunner().invoke(group, ["build", *map(str, arguments)], catch_exceptions=False)


def values(db, term):
    return db[term]["value"].sel(mach=0.15)


def test_every_case_of_a_listing_gets_its_role(read):
    assert roles(read("multi")) == [("clean",), ("flaps",), ("elevator",), ("aileron",)]
    assert roles(read("multi")["flaps"], read("multi")["TOTAL"]) == [("flaps",), ("clean",)]
    assert roles(read("jet_pair")) == roles(read("prop_pair")) == [("clean",), ("power",)]
    assert roles(read("wing_body"), read("multi")[0]) == [(), ("clean",)]


@pytest.mark.nightly
def test_without_a_clean_case_the_elevator_case_gives_its_static_pages(read, light):
    found = assign_roles(read("plus"))
    assert [item.roles for item in found] == [("flaps",), ("aileron",), ("clean", "elevator"), ()]
    assert (
        "left out as clean: conditions of plus.out:3" in found[3].reason
    )  # SAVE behind the last case computes it again
    with pytest.warns(AeromatchWarning, match="no dynamic page"):
        saved = aerodb.from_datcom(light, **by_role(assign_roles([read("plus")])))
    clean = aerodb.from_datcom(light, **by_role(assign_roles([read("multi")])))
    assert (
        {"CL/basic", "Cn/beta", "CL/flap", "Cm/elevator", "Cl/aileron"}
        <= set(aerodb.terms(saved))
        < set(aerodb.terms(clean))
    )
    for term, leaf in aerodb.terms(saved).items():  # the last case of plus has no DAMP, so no rates
        np.testing.assert_array_equal(leaf["value"], clean[term]["value"], err_msg=term)


@pytest.mark.nightly
def test_a_device_inherited_by_save_leaves_the_static_pages_clean(read, light):
    """An ASYFLP saved for the next case, and no case of the whole aeroplane without a device."""
    found = assign_roles(read("inherited"))
    assert [item.roles for item in found] == [(), ("clean",)]
    assert "STYPE=1 is a spoiler, and no height DELTAS is given" in found[1].reason
    saved = aerodb.from_datcom(light, **by_role(found))
    clean = aerodb.from_datcom(light, clean=read("multi")[0])
    for term in ("CL/basic", "Cm/qhat", "Cn/beta"):
        np.testing.assert_array_equal(saved[term]["value"], clean[term]["value"], err_msg=term)


@pytest.mark.nightly
def test_further_angles_of_attack_continue_a_case(read, light):
    """The program takes 20 angles a case: longer schedules are chains of cases."""
    found = assign_roles(read("angles"))
    assert [item.roles for item in found] == [("clean",), ("clean",)]
    db = aerodb.from_datcom(light, **by_role(found))
    first, second = (aerodb.from_datcom(light, clean=case) for case in read("angles"))
    for term in ("CL/basic", "Cm/basic", "Cl/phat"):
        leaf = values(db, term)
        assert np.degrees(leaf["alpha"].values) == pytest.approx([-4.0, 0.0, 4.0, 8.0, 12.0])
        # 4 deg is in both cases; the first has it
        np.testing.assert_array_equal(leaf[:3], values(first, term), err_msg=term)
        np.testing.assert_array_equal(leaf[3:], values(second, term)[1:], err_msg=term)


def test_the_device_of_another_aircraft_has_no_role(read):
    """A folder with listings of two aircraft: the second has a wing of another span."""
    flaps = read("multi")["flaps"]
    other = dataclasses.replace(flaps, deck=read("two_aircraft")[1].deck)
    found = assign_roles([read("multi")["TOTAL"], flaps, other])
    assert [item.roles for item in found] == [("clean",), ("flaps",), ()]
    assert "another aircraft than multi.out:1, the area of its wing is" in found[2].reason


def test_the_same_angles_again_do_not_continue_a_case(read):
    case = read("angles")[0]
    assert [item.roles for item in assign_roles([case, case])] == [("clean",), ()]


def test_a_listing_that_was_copied_over_another_is_warned_of(read):
    case = read("angles")[0]
    copy = dataclasses.replace(case, file="elevator_m0.2.out")
    with pytest.warns(
        AeromatchWarning, match=r"m0.2.out:1 is left out as clean: it prints the sam"
    ):
        assert [item.roles for item in assign_roles([case, copy])] == [("clean",), ()]


def test_several_aircraft_are_refused(read):
    with pytest.raises(
        SchemaError,
        match=r"two_aircraft\.out:1 'LIGHT SINGLE A' and two_aircraft\.out:2 .* differ in "
        r"WGPLNF \(SSPN SSPNE\); give one with",
    ):
        assign_roles(read("two_aircraft"))


def test_a_whole_listing_in_one_role_is_refused_with_the_way_out(read, light):
    with pytest.raises(
        SchemaError, match=r"elevator: 4 cases cannot be joined(?s:.*)let the roles be found"
    ):
        aerodb.from_datcom(light, clean=read("multi")[0], elevator=read("multi"))


@pytest.mark.slow
def test_of_equal_conditions_the_shortest_flap_run_is_taken(t37):
    names = (
        "elevator",
        "elevator_one_by_one",
        "clean",
        "build",
        "ground_flap_one_by_one",
        "ground_flap",
        "ground",
    )
    looped, *single, clean, build_up, flap_0, flap_20, flap_40, together, ground = assign_roles(
        t37[name] for name in names
    )
    assert looped.roles == build_up.roles == ()
    assert "conditions of t37_elevator_one_by_one.pdas.out:1" in looped.reason
    assert [item.roles for item in single] == [("elevator",)] * 6
    assert (clean.roles, ground.roles) == (("clean",), ("ground",))
    assert [item.roles for item in (flap_0, flap_20, flap_40)] == [("ground_flap",)] * 3
    assert together.roles == ()
    assert (
        "only the first of several deflections of a run is right; run one at a time (datcom split)"
        in together.reason
    )


def test_another_flap_is_no_part_of_the_first(read, corpus):
    found = assign_roles([read("multi"), *corpus("ce500_flaps")])
    assert [item.roles for item in found[-2:]] == [(), ()]
    assert "left out as flaps: another SYMFLP than in multi.out:2" in found[-1].reason


@pytest.mark.nightly
def test_a_folder_of_listings_is_built(aircraft, tmp_path):
    for name in ("multi", "wing_body"):
        (tmp_path / f"{name}.out").write_bytes((LISTINGS / f"{name}.out").read_bytes())
    done = build(tmp_path, "-o", tmp_path / "db.nc")
    assert done.exit_code == 0
    rows = [line.split() for line in done.stdout.splitlines()[1:6]]
    assert [(row[0], row[1]) for row in rows] == [
        *(("multi.out", str(number)) for number in range(1, 5)),
        ("wing_body.out", "1"),
    ]
    assert "WING-BODY: a part of WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL" in done.stdout
    found = aerodb.terms(aerodb.open(tmp_path / "db.nc"))
    assert {"CL/flap", "Cm/elevator", "Cl/aileron"} <= set(found)
    document = json.loads(build(aircraft, tmp_path, "-o", tmp_path / "db.nc", "--json").stdout)
    assert document["roles"][1][:4] == ["multi.out", "2", "Flaps: Light Single", "flaps"]


def test_what_a_folder_lacks_is_reported(aircraft, tmp_path):
    output = tmp_path / "db.nc"
    with pytest.raises(FileNotFoundError, match="no listing of Digital DATCOM in this folder"):
        build(aircraft, tmp_path, "-o", output)
    with pytest.raises(SchemaError, match=r"those of WING-BODY, .* or state `tailless`"):
        build(aircraft, f"{LISTINGS / 'multi.out'}:flaps:", "-o", output)
    (tmp_path / "empty").mkdir()
    assert "no aircraft.toml in the folder" in build(tmp_path / "empty", "-o", output).output
    assert not output.exists()


@pytest.mark.nightly
@pytest.mark.parametrize("option", ["", "--clean"])
def test_a_wing_body_is_no_whole_aircraft_unless_stated(aircraft, tmp_path, option):
    place = [option, LISTINGS / "wing_body.out"] if option else [LISTINGS / "wing_body.out"]
    with pytest.raises(
        SchemaError,
        match=r"are those of WING-BODY, not of the whole aeroplane: .*; give the case with HTPLNF "
        r"and VTPLNF",
    ):
        build(aircraft, *place, "-o", tmp_path / "db.nc")
    assert build(aircraft, *place, "--tailless", "-o", tmp_path / "db.nc").exit_code == 0


@pytest.mark.nightly
def test_without_reference_that_of_the_cards_is_taken(aircraft, tmp_path, read, light):
    aircraft.write_text(AIRCRAFT)
    done = build(aircraft, f"{LISTINGS / 'multi.out'}:1", "-o", tmp_path / "db.nc")
    assert "XCG 2.195 m, ZCG 0.03048 m" in done.stderr
    found = aerodb.open(tmp_path / "db.nc")
    assert [found.attrs[name] for name in ("x_ref", "y_ref", "z_ref")] == pytest.approx(
        [-7.2 * FOOT, 0.0, -0.1 * FOOT]
    )
    stated = aerodb.from_datcom(light, clean=read("multi")[0])
    np.testing.assert_array_equal(values(found, "Cm/basic"), values(stated, "Cm/basic"))


@pytest.mark.nightly
def test_a_reference_far_from_the_cards_is_an_error_unless_stated(light, read):
    clean = read("multi")[0]
    near, far = (
        dataclasses.replace(light, reference=(-7.2 * FOOT - d * light.cbar, 0.0, -0.1 * FOOT))
        for d in (0.09, 0.11)
    )
    aerodb.from_datcom(near, clean=clean)
    with pytest.raises(
        SchemaError,
        match=r"lies 0\.11 chords from the moment centre of multi\.out \(XCG 2\.195 m, .*; "
        r"clean\); correct it",
    ):
        aerodb.from_datcom(far, clean=clean)
    moved = aerodb.from_datcom(far, clean=clean, move_reference=True)
    here = aerodb.from_datcom(light, clean=clean)
    CN = values(here, "CL/basic").sel(alpha=0.0)  # at alpha 0 the normal force is the lift
    np.testing.assert_allclose(
        values(moved, "Cm/basic").sel(alpha=0.0),
        values(here, "Cm/basic").sel(alpha=0.0) + 0.11 * CN,
        atol=1e-12,
    )


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["jet", "prop"])
def test_powered_and_unpowered_cases_of_one_listing_are_separated(light, read, kind):
    free, powered = read(f"{kind}_pair")
    together = aerodb.from_datcom(light, clean=read(f"{kind}_pair"))
    apart = aerodb.from_datcom(light, clean=free, power=powered)
    assert list(aerodb.terms(together)) == list(aerodb.terms(apart))
    assert "Cm/power" in aerodb.terms(together)
    np.testing.assert_array_equal(values(together, "CL/basic"), values(apart, "CL/basic"))


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("kind", "words"), [("jet", "jet power at CT = 0.12"), ("prop", "propeller power at CT = 0.1")]
)
def test_powered_pages_are_used_when_stated(light, read, kind, words):
    """The thrust itself is off; the remainder lies within two of the inflated standard errors of
    the page without power.
    """
    free, powered = read(f"{kind}_pair")
    with pytest.raises(
        SchemaError, match=r"are computed with power .*state `powered` \(--powered\)"
    ):
        aerodb.from_datcom(light, clean=powered)
    with pytest.warns(
        AeromatchWarning, match=f"CL, CD and Cm are computed with {words}: thrust itself taken off"
    ):
        db = aerodb.from_datcom(light, clean=powered, powered=True)
    without = aerodb.from_datcom(light, clean=free)
    printed = powered.to_datatree()["static"].to_dataset().isel(condition=0)
    thrust = CT[kind] * np.sin(printed["alpha"].values)
    np.testing.assert_allclose(values(db, "CL/basic"), printed["CL"] - thrust, atol=1e-12)
    assert words in db["CL/basic"].attrs["comment"]
    for term in ("CL/basic", "CD/basic", "Cm/basic"):
        left = values(db, term) - values(without, term)
        stderr, usual = (tree[term]["stderr"].sel(mach=0.15) for tree in (db, without))
        assert float(np.abs(left / stderr).max()) < 2.0
        # a jet has no drag of its own in the program, and no further error
        assert bool((stderr > 1.05 * usual).any()) == ((kind, term) != ("jet", "CD/basic"))
    for term in ("Cl/beta", "Cm/qhat", "Cn/rhat"):
        np.testing.assert_array_equal(values(db, term), values(without, term))
    assert float(values(db, "CL/basic").sel(alpha=4.0 * DEGREE, method="nearest")) != float(
        printed["CL"][2]
    )


def test_powered_pages_cannot_be_clean_and_power_at_once(light, read):
    _, powered = read("jet_pair")
    with pytest.raises(SchemaError, match="powered pages are stated to be the clean ones"):
        aerodb.from_datcom(light, clean=powered, power=powered, powered=True)


@pytest.mark.nightly
def test_an_increment_printed_alone_is_taken_out(jet, corpus):
    """ce500_jet.out, Mach 0.2, alpha 18 to 22: no CM without power, CM -0.0699 ... is the increment
    alone; CMA shows NA.
    """
    with pytest.warns(AeromatchWarning):
        db = aerodb.from_datcom(jet, clean=corpus("ce500_jet"), powered=True)
    Cm = db["Cm/basic"].to_dataset().sel(mach=0.2)
    assert float(Cm["alpha"].max()) == pytest.approx(22 * DEGREE)
    assert float(Cm["value"].sel(alpha=22 * DEGREE, method="nearest")) == float(
        Cm["value"].sel(alpha=16 * DEGREE, method="nearest")
    )


ELEVATOR_SPAN = "SPANFI=0.4,SPANFO=5.3"


@pytest.fixture
def listing_with_span(tmp_path):
    """Return a reader of the listing with another outer station of the elevator. [ft]"""

    def with_span(outer: float):
        text = (LISTINGS / "multi.out").read_text()
        assert ELEVATOR_SPAN in text
        file = tmp_path / "span.out"
        file.write_text(text.replace(ELEVATOR_SPAN, f"SPANFI=0.4,SPANFO={outer}"))
        return datcom_io.read(file)

    return with_span


def test_a_device_beyond_the_tip_of_its_surface_has_no_role(listing_with_span, light):
    """The program computes the flap of a wing on the tail; SSPN of the tail is 5.4 ft."""
    listing = listing_with_span(8.5)
    found = assign_roles([listing])
    assert [item.roles for item in found] == [("clean",), ("flaps",), (), ("aileron",)]
    assert "SPANFO=8.5 lies beyond the tip, SSPN=5.4 of $HTPLNF" in found[2].reason
    with pytest.raises(SchemaError, match=r"(?s)elevator.*SPANFO=8.5 lies beyond the tip"):
        aerodb.from_datcom(light, clean=listing[0], elevator=listing[2])


@pytest.fixture
def listing_with(tmp_path):
    """Return a reader of the listing with other cards; a role names the case."""

    def with_cards(*changes: tuple[str, str]):
        text = (LISTINGS / "multi.out").read_text()
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        file = tmp_path / "cards.out"
        file.write_text(text)
        return datcom_io.read(file)

    return with_cards


def test_a_device_with_a_larger_chord_than_its_surface_has_no_role(listing_with, light):
    """A flap of the wing that ends inside the tip of the tail, whose chord is 3.3 ft there."""
    listing = listing_with(("CHRDFI=1.3,CHRDFO=0.9", "CHRDFI=3.6,CHRDFO=0.9"))
    found = assign_roles([listing])
    assert [item.roles for item in found] == [("clean",), ("flaps",), (), ("aileron",)]
    assert "CHRDFI=3.6 is larger than the chord 3.319 of $HTPLNF" in found[2].reason
    assert "run the flap of a wing without HTPLNF" in found[2].reason
    with pytest.raises(SchemaError, match=r"(?s)elevator.*CHRDFI=3.6 is larger"):
        aerodb.from_datcom(light, clean=listing[0], elevator=listing[2])


def test_a_flap_beyond_the_tail_has_no_role_with_running_engines_either(listing_with):
    """Pages of a device contain no power, so that power does not excuse the device."""
    card = "  $SYMFLP FTYPE=1.0,NDELTA=5.0"
    engine = f"  $PROPWR NENGSP=1.0,THSTCP=0.1$\n{card}"
    case = listing_with((ELEVATOR_SPAN, "SPANFI=0.4,SPANFO=8.5"), (card, engine))[2]
    assert case.deck.value("PROPWR", "THSTCP") == 0.1
    for number, page in enumerate(case.pages):
        if page.kind == "static":
            case.pages[number] = dataclasses.replace(page, power="propeller")
    (found,) = assign_roles([case])
    assert (found.roles, "SPANFO=8.5 lies beyond the tip" in found.reason) == ((), True)


def test_the_advice_on_a_device_of_the_wing_does_not_mention_the_tail(listing_with):
    listing = listing_with(("SPANFO=8.5", "SPANFO=18.5"))
    (reason,) = [item.reason for item in assign_roles([listing]) if not item.roles]
    assert "SPANFO=18.5 lies beyond the tip, SSPN=16.5 of $WGPLNF" in reason
    assert "correct the stations" in reason
    assert "HTPLNF" not in reason


@pytest.mark.parametrize(("deltas", "warned"), [("0.0,10.0,20.0", 1), ("-10.0,0.0,10.0", 0)])
def test_an_elevator_that_moves_down_only_is_reported(read, deltas: str, warned: int):
    """The flap of a wing that fits inside the tip of the tail."""
    cards = f" $SYMFLP FTYPE=1.0,NDELTA=3.0,DELTA(1)={deltas},SPANFI=2.0,SPANFO=5.0$"
    (deck,) = datcom_io.read_deck(["DIM FT", cards, "NEXT CASE"])
    source = collect_source("elevator", read("multi")[2])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AeromatchWarning)
        require_device_on_surface(dataclasses.replace(source, decks=(deck,)))
    texts = [str(item.message) for item in caught]
    assert len(texts) == warned
    assert all("elevator: all deflections of SYMFLP point down (0 10 20 deg)" in x for x in texts)


# Cards of a SYMFLP that fits inside the tail of 5.4 ft, and names of its case.
@pytest.mark.parametrize(
    ("cards", "name", "reason"),
    [
        ("FTYPE=2.0,DELTA(1)=-20.0,0.0,20.0", "Elevator", "FTYPE=2 is a high-lift device"),
        ("FTYPE=1.0,DELTA(1)=0.0,10.0,20.0", "FLAPS", "all deflections point down"),
        ("FTYPE=1.0,DELTA(1)=0.0,10.0,20.0", "Total", ""),
        ("FTYPE=1.0,DELTA(1)=-20.0,0.0,20.0", "FLAPS", ""),
        ("FTYPE=1.0,DELTA(1)=0.0,10.0,20.0", "Elevator by flap setting", ""),
    ],
)
def test_the_flap_of_a_wing_inside_the_tail_is_not_an_elevator(read, cards, name, reason) -> None:
    elevator = read("multi")["Elevator"]
    symflp = f" $SYMFLP {cards},NDELTA=3.0,CHRDFI=0.9,CHRDFO=0.9,SPANFI=0.5,SPANFO=5.0$"
    (deck,) = datcom_io.read_deck([*deck_text([elevator.deck]).splitlines()[:-1], symflp])
    found = assign_roles([read("multi")["TOTAL"], renamed(elevator, deck, name)])
    assert [item.roles for item in found] == [("clean",), () if reason else ("elevator",)]
    assert reason in found[1].reason


# Stations and chords of a flap of the wing, a quarter of its chord, inside the tail of 5.4 ft.
WING_FLAP = " $SYMFLP CHRDFI=1.36,CHRDFO=1.2,SPANFI=1.9,SPANFO=4.9$"


def with_cards(case, name: str, *cards: str):
    """Return a case of another name with cards in addition."""
    (deck,) = datcom_io.read_deck([*deck_text([case.deck]).splitlines()[:-1], *cards])
    return renamed(case, deck, name)


def test_stations_of_the_wing_are_not_those_of_an_elevator(read) -> None:
    """The flap moves to both sides, and comes before the elevator."""
    clean, elevator = read("multi")["TOTAL"], read("multi")["Elevator"]
    flap = with_cards(elevator, "Total", WING_FLAP)
    found = assign_roles([clean, flap, elevator])
    assert [item.roles for item in found] == [("clean",), (), ("elevator",)]
    assert "$SYMFLP: SPANFI=1.9 is 1% of the semispan from the body at the wing" in found[1].reason
    assert "run the flap of a wing without HTPLNF" in found[1].reason


def test_of_two_devices_on_the_tail_the_one_that_fits_is_the_elevator(read) -> None:
    """A case that is named an elevator is never refused for its stations."""
    clean, elevator = read("multi")["TOTAL"], read("multi")["Elevator"]
    doubtful = with_cards(elevator, "Elevator of another deck", WING_FLAP)
    found = assign_roles([clean, doubtful, elevator])
    assert [item.roles for item in found] == [("clean",), (), ("elevator",)]
    assert "left out as elevator: another SYMFLP" in found[1].reason
    alone = assign_roles([clean, doubtful])
    assert alone[1].roles == ("elevator",)
    assert "doubtful: SPANFI=1.9" in alone[1].reason
    source = collect_source("elevator", doubtful)
    with pytest.warns(AeromatchWarning, match=r"SPANFI=1\.9 .* it counts as the elevator"):
        require_device_on_surface(source)


def test_the_cards_of_a_wing_flap_on_the_tail_are_not_an_elevator(read) -> None:
    """One case without and one with HTPLNF have the same SYMFLP."""
    symflp = " $SYMFLP FTYPE=1.0,NDELTA=2.0,DELTA(1)=-9.0,9.0,TC=0.1$"
    span = " $SYMFLP CHRDFI=0.9,CHRDFO=0.9,SPANFI=2.0,SPANFO=5.0$"
    cases = []
    for name in ("flaps", "Elevator"):
        case = read("multi")[name]
        lines = [*deck_text([case.deck]).splitlines()[:-1], symflp, span]
        (deck,) = datcom_io.read_deck(lines)
        cases.append(renamed(case, deck, name))
    found = assign_roles([read("multi")["TOTAL"], *cases])
    assert [item.roles for item in found] == [("clean",), ("flaps",), ()]
    assert "are those of a case without horizontal tail" in found[2].reason


def renamed(case, deck, name):
    """Return a case with another deck and another name."""
    return dataclasses.replace(case, deck=deck, name=name)


def test_one_mach_number_at_two_reynolds_numbers_is_refused_with_the_way_out(read, light) -> None:
    pages = 2 * [read("reynolds")[0]]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AeromatchWarning)
        with pytest.raises(SchemaError, match="several Reynolds numbers, and no altitude; give"):
            aerodb.from_datcom(light, clean=pages, move_reference=True)


def test_of_several_devices_the_one_that_fits_is_used(listing_with_span, read):
    found = assign_roles([listing_with_span(8.5)[2], read("multi")])
    assert [item.roles for item in found][:4] == [(), ("clean",), ("flaps",), ("elevator",)]


@pytest.mark.nightly
def test_a_device_a_little_beyond_the_tip_is_used_with_a_warning(listing_with_span, light):
    listing = listing_with_span(5.5)
    with pytest.warns(AeromatchWarning, match="elevator: .*SPANFO=5.5 lies beyond the tip"):
        db = aerodb.from_datcom(light, clean=listing[0], elevator=listing[2])
    assert "Cm/elevator" in aerodb.terms(db)


def test_a_print_without_angles_of_attack_is_refused(read, light) -> None:
    """A deck without ALSCHD prints static pages that have no row."""
    tree = read("multi")["TOTAL"].to_datatree()
    del tree["static"]
    with pytest.raises(SchemaError, match="hold no row with an angle of attack"):
        aerodb.from_datcom(light, clean=tree)
