from pathlib import Path

import pytest

import datcom_io
from datcom_io.decks.deck_file import deck_text
from flightmech.errors import ParseError, SchemaError

T37 = Path(__file__).parents[3] / "data" / "t37" / "datcom"
GROUND_FLAPS = ["ground_flaps_d0", "ground_flaps_d20", "ground_flaps_d40"]
RUNS = [
    "clean",
    "build",
    "flaps",
    "elevator",
    "aileron",
    "ground",
    *GROUND_FLAPS,
    "ground_elevator",
]


@pytest.fixture(scope="module")
def planned():
    return datcom_io.split_deck(T37 / "t37_study.toml")


@pytest.fixture(scope="module")
def unplanned():
    return datcom_io.split_deck(T37 / "t37_study.inp")


@pytest.mark.parametrize("name", [name for name in RUNS if name not in GROUND_FLAPS])
def test_the_t37_study_gives_the_shipped_decks(planned, name):
    shipped = datcom_io.read_deck(T37 / f"t37_{name}.inp")
    assert list(planned) == RUNS
    assert planned[name][0].meaning() == shipped[0].meaning()


def test_every_flap_setting_over_ground_is_a_run_of_its_own(planned):
    """The shipped decks differ in CASEID only."""
    shipped = datcom_io.read_deck(T37 / "t37_ground_flap_one_by_one.inp")
    for name, case in zip(GROUND_FLAPS, shipped, strict=True):
        ours = planned[name][0]
        assert (
            ours.caseid
            == f"T-37 OWN DECK WING-BODY FLAPS IN GROUND EFFECT {name.split('_')[-1].upper()}"
        )
        assert {**ours.meaning(), "caseid": ""} == {**case.meaning(), "caseid": ""}


@pytest.mark.slow
def test_without_a_plan_every_condition_and_deflection_is_a_run_of_its_own(unplanned):
    """The nine decks of a condition are those of one shipped deck in all but the deflection."""
    shipped = datcom_io.read_deck(T37 / "t37_elevator_one_by_one.inp")
    for mach, case in zip((0.15, 0.2, 0.3, 0.4, 0.5, 0.6), shipped, strict=True):
        runs = [name for name in unplanned if name.startswith(f"elevator_m{mach:g}_h0_")]
        assert runs == [
            f"elevator_m{mach:g}_h0_d{delta}" for delta in (-25, -20, -15, -10, -5, 0, 5, 10, 15)
        ]
        ours = [unplanned[name][0] for name in runs]
        assert ours[0].caseid == f"T-37 OWN DECK STUDY ELEVATOR M{mach:g} H0 D-25"
        assert [deck.schedule("SYMFLP", "DELTA", "NDELTA")[0] for deck in ours] == case.schedule(
            "SYMFLP", "DELTA", "NDELTA"
        )
        assert {**ours[0].namelists, "SYMFLP": {}} == {**case.namelists, "SYMFLP": {}}


def test_geometry_of_the_flap_goes_with_its_deflection(unplanned):
    """CPRMEI and CPRMEO hold the extended chords of each deflection."""
    group = unplanned["flaps_m0.15_h0_d20"][0].namelists["SYMFLP"]
    assert (group["NDELTA"], group["DELTA"], group["CPRMEI"], group["CPRMEO"]) == (
        [1.0],
        [20.0],
        [6.07],
        [5.42],
    )


def test_without_a_plan_all_that_the_deck_gives(unplanned):
    assert [name for name in unplanned if "_m" not in name] == ["clean", "aileron", "ground"]
    conditions = [
        f"m{mach:g}_h{height}"
        for height in (0, 10000, 20000)
        for mach in (0.15, 0.2, 0.3, 0.4, 0.5, 0.6)
    ]
    for run in ("flaps", "ground_flaps"):
        wanted = [f"{run}_{words}_d{delta}" for words in conditions for delta in (0, 20, 40)]
        assert [name for name in unplanned if name.startswith(f"{run}_m")] == wanted
    assert len(unplanned) == 3 + 18 * (3 + 9 + 3)


def test_wing_devices_come_without_tail(unplanned):
    for name in ("flaps_m0.15_h0_d20", "aileron", "ground_flaps_m0.15_h0_d40"):
        deck = unplanned[name][0]
        assert not {"HTPLNF", "VTPLNF"} & deck.namelists.keys()
        assert set(deck.sections) == {"W"}
        assert not {"XH", "ALIH", "XV", "VERTUP"} & deck.namelists["SYNTHS"].keys()
    assert {"HTPLNF", "VTPLNF"} <= unplanned["elevator_m0.15_h0_d0"][0].namelists.keys()


@pytest.mark.slow
def test_every_run_deck_is_complete_and_without_errors(unplanned, tmp_path):
    for name, deck in list(unplanned.items())[::10]:
        path = tmp_path / deck.file
        datcom_io.write_deck(deck, path, resolved=True)
        assert not [
            finding for finding in datcom_io.check_deck(path) if finding.severity == "error"
        ]
        assert datcom_io.read_deck(path)[0].meaning() == deck[0].meaning()
        assert len(deck) == 1
        assert path.name == f"{name}.inp"


def study(**changes):
    lines = {
        "cards": "TRIM\nDAMP\nBUILD",
        "FLTCON": " $FLTCON NMACH=2.0,MACH(1)=0.2,0.3,NALT=2.0,ALT(1)=0.0,1000.0,\n   "
        "NALPHA=2.0,ALSCHD(1)=0.0,2.0$",
        "OPTINS": " $OPTINS SREF=24.2,CBARR=2.0,BLREF=13.4$",
        "SYNTHS": " $SYNTHS XCG=6.3,XW=5.4,XH=11.3$",
        "BODY": " $BODY NX=3.0,X(1)=0.0,6.0,13.0,R(1)=0.0,0.8,0.1$",
        "WGPLNF": " $WGPLNF CHRDR=2.9,CHRDTP=0.8,SSPN=6.7,SSPNE=5.9,TYPE=1.0$",
        "HTPLNF": " $HTPLNF CHRDR=1.5,CHRDTP=0.8,SSPN=2.9,SSPNE=2.8,TYPE=1.0$",
        "NACA": "NACA W 4 2412\nNACA H 4 0010",
        "flap": " $SYMFLP FTYPE=1.0,NDELTA=2.0,DELTA(1)=0.0,10.0,SPANFI=1.0,SPANFO=2.5,\n   "
        "CHRDFI=0.5,CHRDFO=0.4$",
        "CASEID": "CASEID JET",
        **changes,
    }
    return datcom_io.read_deck("\n".join(text for text in lines.values() if text).split("\n"))


FLAP = " $SYMFLP FTYPE=1.0,NDELTA=2.0,DELTA(1)=0.0,10.0,SPANFI=1.0,SPANFO=4.5,\n   CHRDFI=0.5$"


def test_a_flap_that_fits_both_surfaces_must_be_named():
    with pytest.raises(
        SchemaError,
        match=r"\$SYMFLP: it may be on the wing or on the tail; name it in a study file",
    ) as caught:
        datcom_io.split_deck(study())
    assert "allowed: flaps, slats, elevator, or by a comment above it" in str(caught.value)


def test_a_comment_above_names_a_device():
    text = study()[0]
    marked = study(
        flap="* Elevator, full span\n $SYMFLP "
        "FTYPE=1.0,NDELTA=2.0,DELTA(1)=0.0,10.0,SPANFI=1.0,SPANFO=2.5$"
    )
    assert text.namelists["SYMFLP"]["NDELTA"] == [2.0]
    assert list(datcom_io.split_deck(marked))[1] == "elevator_m0.2_h0"


def test_cards_go_to_the_runs_they_belong_to():
    decks = datcom_io.split_deck(
        study(flap=f"{FLAP}\n $ASYFLP STYPE=5.0,NDELTA=1.0,DELTAL(1)=5.0,DELTAR(1)=-5.0$")
    )
    switches = {name: decks[name][0].meaning()["switches"] for name in decks}
    assert switches["clean"] == {"DAMP", "BUILD"}
    assert switches["flaps_m0.2_h0_d0"] == {"DAMP"}
    assert "HTPLNF" in decks["differential_tail"][0].namelists
    moving = datcom_io.split_deck(
        study(SYNTHS=" $SYNTHS XCG=6.3,XW=5.4,XH=11.3,HINAX=11.8$", flap=FLAP)
    )
    assert moving["clean"][0].has("TRIM")
    assert not moving["flaps_m0.2_h0_d0"][0].has("TRIM")


def test_pairs_of_mach_and_altitude_stay_pairs():
    decks = datcom_io.split_deck(study(flap=FLAP))
    assert list(decks) == [
        "clean",
        *(
            f"flaps_{place}_{delta}"
            for place in ("m0.2_h0", "m0.3_h1000")
            for delta in ("d0", "d10")
        ),
    ]


def test_one_device_over_two_groups():
    decks = datcom_io.split_deck(study(flap=f"{FLAP}\n $SYMFLP CB=0.1$"))
    assert decks["flaps_m0.2_h0_d0"][0].value("SYMFLP", "CB") == 0.1


def test_two_devices_of_a_kind_are_distinguished():
    assert list(datcom_io.split_deck(study(flap=f"{FLAP}\n{FLAP}")))[1::4] == [
        "flaps_m0.2_h0_d0",
        "flaps_2_m0.2_h0_d0",
    ]


def test_tabs_go_with_the_elevator():
    tab = " $CONTAB TTYPE=1.0,CFITC=0.1$"
    elevator = "* ELEVATOR\n $SYMFLP FTYPE=1.0,NDELTA=2.0,DELTA(1)=0.0,10.0,SPANFI=1.0,SPANFO=2.5$"
    decks = datcom_io.split_deck(study(flap=f"{FLAP}\n{elevator}\n{tab}"))
    assert [name for name, deck in decks.items() if "CONTAB" in deck[0].namelists] == [
        "elevator_m0.2_h0",
        "elevator_m0.3_h1000",
    ]


def test_a_study_that_would_not_run_is_refused_with_all_faults():
    with pytest.raises(SchemaError) as caught:
        datcom_io.split_deck(
            study(NACA="NACA W 4 2412", BODY=" $BODY NX=3.0,X(1)=0.0,6.0,13.0$", flap=FLAP)
        )
    text = "line 8 of the study: $BODY: of R, S and P there is none of them"
    assert [problem.split(";")[0] for problem in caught.value.problems[:1]] == [
        f"run clean and 4 more: {text}"
    ]
    assert "run clean: line 10 of the study: $HTPLNF without section" in caught.value.problems[1]


def test_a_value_that_the_program_corrects_is_no_reason_to_refuse():
    """The program moves a flap that begins inside the body to its side and computes."""
    decks = datcom_io.split_deck(study(flap=FLAP.replace("SPANFI=1.0", "SPANFI=0.7")))
    assert decks["flaps_m0.2_h0_d0"][0].value("SYMFLP", "SPANFI") == 0.7
    assert any(
        "lies inside the body" in finding.text
        for finding in datcom_io.check_deck(decks["flaps_m0.2_h0_d0"])
    )


BANNER = "***************\n*  Symmetrical Flap Deflection parameters\n***************\n"


def test_a_heading_above_a_device_is_no_name():
    """Above the elevator of a DATCOM+ deck stands what SYMFLP means; its span fits the tail
    only.
    """
    elevator = f"{BANNER} $SYMFLP FTYPE=1.0,NDELTA=2.0,DELTA(1)=0.0,10.0,SPANFI=0.2,SPANFO=2.8$"
    assert list(datcom_io.split_deck(study(flap=elevator)))[1] == "elevator_m0.2_h0"
    inside = elevator.replace("SPANFI=0.2", "SPANFI=0.0")  # the program takes 0.1
    assert list(datcom_io.split_deck(study(flap=inside)))[1] == "elevator_m0.2_h0"
    assert (
        list(datcom_io.split_deck(study(flap=inside.replace("Symmetrical Flap", "Wing flap"))))[1]
        == "elevator_m0.2_h0"
    )
    with pytest.raises(
        SchemaError, match="it may be on the wing or on the tail; name it in a study file"
    ):
        datcom_io.split_deck(study(flap=elevator.replace("SPANFI=0.2", "SPANFI=1.0")))
    slats = FLAP.replace("FTYPE=1.0", "FTYPE=7.0")
    assert list(datcom_io.split_deck(study(flap=f"* SLATS\n{slats}")))[1] == "slats_m0.2_h0_d0"


def test_what_is_no_study():
    with pytest.raises(SchemaError, match="2 cases; a study is one case"):
        datcom_io.split_deck(
            datcom_io.read_deck([*deck_text(study()).split("\n"), " $BODY NX=1.0$"])
        )
    with pytest.raises(SchemaError, match="make cases of their own"):
        datcom_io.split_deck(datcom_io.read_deck([" $LARWB ZB=1.0$"]))


def write(folder, text):
    datcom_io.write_deck(datcom_io.read_deck(T37 / "t37_study.inp"), folder / "study.inp")
    path = folder / "study.toml"
    path.write_text(text)
    return path


def test_faults_of_a_study_file_are_reported_at_once(tmp_path):
    with pytest.raises(SchemaError) as caught:
        datcom_io.split_deck(
            write(
                tmp_path,
                'devices = "flaps"\nmach = 1\n[runs.clean]\nseparate = "no"\nalpha = '
                "2\n[runs]\nground = 1\n",
            )
        )
    assert caught.value.problems == [
        "no deck; write deck = 'file.inp'",
        "unknown key mach; allowed: deck, title, devices, runs",
        "devices is 'flaps'; it must be a list",
        "unknown key runs.clean.alpha; allowed: caseid, cards, separate",
        "runs.clean.separate is 'no'; it must be a bool",
        "runs.ground is not a table",
    ]


def test_faults_of_names_and_cards(tmp_path):
    head = 'deck = "study.inp"\n'
    with pytest.raises(SchemaError, match="devices names 1, the deck has 3"):
        datcom_io.split_deck(write(tmp_path, head + 'devices = ["flaps"]\n'))
    with pytest.raises(
        SchemaError,
        match=r"\$ASYFLP: device 'elevator'; name it in a study file.*allowed: aileron, spoiler, "
        r"differential_tail",
    ):
        datcom_io.split_deck(
            write(tmp_path, head + 'devices = ["flaps", "elevator", "elevator"]\n')
        )
    with pytest.raises(
        SchemaError,
        match="run 'rudder'; allowed: clean, build, flaps, elevator, aileron, ground, ground_flaps",
    ):
        datcom_io.split_deck(write(tmp_path, head + "[runs.rudder]\n"))
    with pytest.raises(SchemaError, match=r"runs.clean.cards, line 1: not a control card: \?DAMP"):
        datcom_io.split_deck(write(tmp_path, head + '[runs.clean]\ncards = "?DAMP"\n'))
    with pytest.raises(ParseError, match=r"study.toml: found .*; expected a TOML text"):
        datcom_io.split_deck(write(tmp_path, "deck = "))


def test_ground_runs_need_heights(tmp_path):
    deck = study(flap=FLAP)
    datcom_io.write_deck(deck, tmp_path / "study.inp")
    (tmp_path / "study.toml").write_text('deck = "study.inp"\n[runs.ground]\n')
    with pytest.raises(SchemaError, match=r"run 'ground' needs \$GRNDEF in the deck"):
        datcom_io.split_deck(tmp_path / "study.toml")


def test_a_caseid_is_never_longer_than_a_card(tmp_path):
    text = (
        f'deck = "study.inp"\ntitle = '
        f'"{"T" * 100}"\n[runs.ground_flaps]\n[runs.clean]\ncaseid = "{"C" * 100}"\n'
    )
    decks = datcom_io.split_deck(write(tmp_path, text))
    assert {len(deck[0].caseid) for deck in decks.values()} <= {
        73,
        74,
    }  # the blank before the label may be the last of the title
    assert decks["ground_flaps_m0.6_h20000_d40"][0].caseid.endswith(
        "T FLAPS, WING-BODY IN GROUND EFFECT M0.6 H20000 D40"
    )


def test_experimental_data_follow_their_mach_number(tmp_path):
    deck = study(flap=f"{FLAP}\n $EXPR02 CLB(1)=0.1,0.2$")
    decks = datcom_io.split_deck(deck)
    assert "EXPR02" in decks["clean"][0].namelists
    assert [
        name for name in decks["flaps_m0.2_h0_d0"][0].namelists if name.startswith("EXPR")
    ] == []
    assert decks["flaps_m0.3_h1000_d0"][0].namelists["EXPR01"] == {"CLB": [0.1, 0.2]}
    datcom_io.write_deck(deck, tmp_path / "study.inp")
    (tmp_path / "study.toml").write_text(
        'deck = "study.inp"\n[runs.clean]\ncards = " $FLTCON NMACH=1.0,MACH(1)=0.3$"\n'
    )
    with pytest.raises(
        SchemaError,
        match=r"runs.clean.cards change the Mach numbers that the EXPRnn of the study count",
    ):
        datcom_io.split_deck(tmp_path / "study.toml")


def test_a_condition_given_twice_is_run_once():
    flight = (
        " $FLTCON NMACH=2.0,MACH(1)=0.2,0.2,NALT=2.0,ALT(1)=0.0,0.0,\n   "
        "NALPHA=2.0,ALSCHD(1)=0.0,2.0$"
    )
    assert list(datcom_io.split_deck(study(flap=FLAP, FLTCON=flight))) == [
        "clean",
        "flaps_m0.2_h0_d0",
        "flaps_m0.2_h0_d10",
    ]


def test_conditions_that_differ_in_temperature_only_are_two():
    flight = (
        " $FLTCON NMACH=1.0,MACH(1)=0.2,NALT=2.0,PINF(1)=2116.0,2116.0,LOOP=2.0,\n   "
        "TINF(1)=518.7,560.0,NALPHA=2.0,ALSCHD(1)=0.0,2.0$"
    )
    decks = datcom_io.split_deck(study(flap=FLAP, FLTCON=flight))
    warm = decks["flaps_m0.2_p2116_t560_d10"][0]
    assert len(decks) == 5
    assert warm.namelists["FLTCON"]["TINF"] == [560.0]
