"""Drafted name maps and geometry: names and units of columns, and the reference of the cards."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aeromatch.drafting.geometry import geometry_of
from aeromatch.drafting.name_map.column_units import unit_from_size
from aeromatch.drafting.name_map.columns import explain_unit, explain_unknown, guess_quantity
from aeromatch.drafting.name_map.names import draft_names
from flightmech.units import FOOT

TESTS = Path(__file__).parents[2]
LISTINGS = TESTS / "aerodb" / "listings"
CLEAN = TESTS.parent / "data" / "t37" / "datcom" / "t37_clean.out"


@pytest.mark.parametrize(
    ("column", "name", "unit"),
    [
        ("KIAS", "V_cas", "kt"), ("ktas", "V", "kt"), ("roll_rate_dps", "p", "deg/s"),
        ("q_deg_s", "q", "deg/s"), ("Pitch", "theta", None),
        ("ALT_ft", "h_baro", "ft"), ("gps/altitude", "h_gps", None), ("NormAcc", "az_imu", None),
        ("acc_x_mss", "ax_imu", "m/s2"), ("fz_mss", "az_imu", "m/s2"),
        ("AOA_BOOM", "alpha_vane", None),
        ("Elevator_Pos_deg", "delta_e", "deg"), ("AIL_L_deg", "delta_a_left", "deg"),
        ("AileronRight", "delta_a_right", None),
        ("N1_2", "engine2.n1", None), ("thrust_left_lbf", "engine1.thrust", "lbf"),
        ("Eng2N1", "engine2.n1", None),
        ("OAT_C", "temperature", "degC"), ("fuel_flow_pph", "engine1.fuel_flow", "lb/h"),
        ("weight_lb", "mass", "lb"),
        ("FN1 [lbf]", "engine1.thrust", "lbf"), ("ALT_STD_M", "h_baro", "m"),
        ("GS_N_KMH", "vn", "km/h"), ("FF1 KG/H", "engine1.fuel_flow", "kg/h"),
        ("TLA 1 DEG", "engine1.pla", "deg"), ("INERTIAL VERT SPEED", "hdot", None),
        ("TRUE HDG", "psi", None), ("AOA1_DEG", "alpha_vane", "deg"),
        ("flightdata.Pitch", "theta", None), ("stick_force_lbf", "F_column", "lbf"),
        ("x_cg", "x_cg_b", None), ("delta_r", "delta_r", None),
        ("Hoehenruder_Grad", "delta_e", "deg"), ("Höhenruder [°]", "delta_e", "deg"),
        ("Nickrate [Grad/s]", "q", "deg/s"),
        ("Querruder links [Grad]", "delta_a_left", "deg"), ("Schub_N", "engine1.thrust", "N"),
        ("Steigen_m/s", "hdot", "m/s"),
        ("ELEV POSN [DEG]", "delta_e", "deg"), ("N-S VELOCITY [KT]", "vn", "kt"),
        ("ALTITUDE 1013.25 [FT]", "h_baro", "ft"),
        ("SIDESLIP_VANE_DEG", "beta_vane", "deg"), ("PITCH_ATT_DEG", "theta", "deg"),
        ("ROLL_ATT_DEG", "phi", "deg"), ("VVI_FPM", "hdot", "ft/min"),
        ("AIL_DEG_RRD", "delta_a", "deg"), ("ENG1_PLA_PCT", "engine1.throttle", "%"),
        ("ENG2_PLA_DEG", "engine2.pla", "deg"),
    ],
)  # fmt: skip
def test_columns_are_recognised_by_their_names(column, name, unit):
    found = guess_quantity(column)
    assert (found.name, found.unit) == (name, unit)


@pytest.mark.parametrize("column", [
        "LATERAL VELOCITY", "Kurs_Grad",
        "spare_7", "Event", "FX_N", "NZ_CG", "CG_FS", "TAT", "gs_kt", "time", "status", "MAG HDG", "CG %MAC", "ELEV_CMD",
        "CABIN ALT", "TQ1 [%]", "FLAP LEVER",
        "TOTAL PRESS", "AIL TRIM", "AILERON_PCT", "GEAR_DEG", "PITCH_FPM",
    ],
)  # fmt: skip
def test_columns_without_a_quantity_are_left_out(column):
    assert guess_quantity(column) is None


def test_a_unit_that_contradicts_its_heading_is_the_reason():
    text = "the unit {} of its heading contradicts {}, which is in {}"
    assert explain_unit("AILERON_PCT") == text.format("%", "delta_a", "rad")
    assert explain_unit("PITCH_FPM") == text.format("ft/min", "theta", "rad")
    assert explain_unit("AIL_DEG_RRD") == explain_unit("spare_7") == ""
    assert guess_quantity("AIL_DEG_RRD").sign == -1


def test_a_sense_of_one_recorder_is_to_be_confirmed(tmp_path):
    time = np.arange(200) / 10.0
    angle = np.rad2deg(0.1) * np.sin(time)
    table = pd.DataFrame({"time": time, "AIL_DEG_RRD": angle, "ELEV_DEG_TEU": angle})
    table.to_csv(tmp_path / "run.csv", index=False)
    rows = {row.name: row for row in draft_names([tmp_path / "run.csv"]).rows}
    assert (rows["delta_a"].channel.sign, rows["delta_a"].confidence) == (-1, "CONFIRM")
    assert rows["delta_a"].reason == (
        "CONFIRM: taken as the aileron that rolls right, may be the right aileron trailing edge "
        "down: the other sign; the heading states the opposite positive sense"
    )
    assert (rows["delta_e"].channel.sign, rows["delta_e"].confidence) == (-1, "stated")
    assert guess_quantity("AIL_DEG_LRD").doubt.endswith(
        "left aileron trailing edge down: the other sign"
    )


def test_shaft_speeds_are_in_turns_per_minute():
    units = unit_from_size({"engine1.rpm": np.array([900.0, 2400.0])})
    assert units["engine1.rpm"] == ("rpm", "reaches 2.39e+03")
    units = unit_from_size({"engine1.rpm": np.array([90.0, 240.0])})
    assert units["engine1.rpm"] == ("rpm", "CONFIRM: taken as turns per minute")


def test_a_lever_without_a_unit_is_to_be_confirmed():
    units = unit_from_size({"engine1.pla": np.array([12.0, 85.0])})
    assert units["engine1.pla"] == (
        "deg",
        "CONFIRM: degrees or percent is not stated, reaches 84.6",
    )


@pytest.mark.parametrize(
    ("column", "reason"),
    [("MAG HDG", "a magnetic heading"), ("ELEV_CMD", "a demand (cmd)"),
        ("EGT1", "a temperature of the engine"), ("spare_7", "")],
)  # fmt: skip
def test_a_known_heading_of_another_subject_has_a_reason(column, reason):
    assert explain_unknown(column).startswith(reason)
    assert bool(explain_unknown(column)) == bool(reason)


def test_units_follow_from_the_size_of_the_values():
    time = np.linspace(0.0, 20.0, 200)
    small = {
        "theta": 4.0 + np.sin(time),
        "delta_r": 0.1 * np.sin(time),
        "p": 8.0 * np.sin(time),
        "az_imu": 1.0 + 0.1 * np.sin(time),
    }
    others = {
        "p_static": 900.0 + time,
        "temperature": 10.0 + 0.0 * time,
        "engine1.n1": 70.0 + time,
        "ax_imu": 0.05 * np.sin(time),
    }
    found = {name: unit for name, (unit, _) in unit_from_size({**small, **others}).items()}
    assert found == {
        "theta": "deg", "delta_r": "deg", "p": "deg/s", "az_imu": "g", "ax_imu": "g",
        "p_static": "hPa", "temperature": "degC",
        "engine1.n1": "%",
    }  # fmt: skip
    radians = unit_from_size(
        {"theta": 0.07 + 0.02 * np.sin(time), "p": 0.1 * np.sin(time), "az_imu": -9.8 + 0.0 * time}
    )
    assert [unit for unit, _ in radians.values()] == ["rad", "rad/s", "m/s2"]
    # the speed of a propeller does not decide on the rates of the aeroplane
    turning = unit_from_size({"engine1.rpm": 2000.0 + time, "p": 0.3 * np.sin(time)})
    assert [unit for unit, _ in turning.values()] == ["rpm", "rad/s"]


def test_a_device_of_no_control_has_no_hinge():
    """A spoiler is not the aileron, and a flap beyond the tip of the tail is not the elevator."""
    assert geometry_of([LISTINGS / "inherited.out"], []).surfaces == {}
    assert set(geometry_of([LISTINGS / "plus.out"], []).surfaces) == {"delta_a", "delta_e"}


def test_geometry_of_cards_and_of_a_deck_alone():
    """T-37: 182 ft2, 5.47 ft, 33.83 ft, XCG 9.88 ft; the reference point is at 0.27 of the mean
    chord (flight/README.md).
    """
    listing, deck = geometry_of([CLEAN], []), geometry_of([], [CLEAN.with_suffix(".inp")])
    for found in (listing, deck):
        np.testing.assert_allclose(
            [found.S, found.cbar, found.b], [182.0 * FOOT**2, 5.47 * FOOT, 33.83 * FOOT], rtol=1e-6
        )
        np.testing.assert_allclose(found.reference, [-9.88 * FOOT, 0.0, 0.0], rtol=1e-6, atol=1e-12)
        assert found.x_ref_mac == pytest.approx(0.27, abs=0.002)
    assert listing.places == {"clean": [str(CLEAN)]}
    assert deck.places == {}


def test_engines_of_a_deck_in_other_units(tmp_path):
    wing = " CASEID A\n DIM M\n $FLTCON NMACH=1.0, MACH(1)=0.3$\n $SYNTHS XCG=3.0, ZCG=0.0$\n"
    jet = " $JETPWR NENGSJ=1.0, JEALOC=10.0, JELLOC=0.0, JEVLOC=1.0$\n"
    texts = {"wing": wing + " $BODY NX=2.0$\n NEXT CASE\n", "jet": f" DIM FT\n{jet} NEXT CASE\n"}
    for name, text in texts.items():
        (tmp_path / f"{name}.inp").write_text(text)
    found = geometry_of([], [tmp_path / "wing.inp", tmp_path / "jet.inp"])
    np.testing.assert_allclose(found.engines, [[3.0 - 10.0 * FOOT, 0.0, -FOOT]], atol=1e-12)


def test_without_optins_the_reference_is_that_of_the_planform(tmp_path):
    text = CLEAN.with_suffix(".inp").read_text()
    (tmp_path / "wing.inp").write_text(
        "\n".join(line for line in text.splitlines() if "OPTINS" not in line)
    )
    found = geometry_of([], [tmp_path / "wing.inp"])
    mean = 2.0 / 3.0 * (6.37 + 4.5 - 6.37 * 4.5 / (6.37 + 4.5))  # of a straight wing
    np.testing.assert_allclose(
        [found.S, found.cbar, found.b],
        [(6.37 + 4.5) * 16.915 * FOOT**2, mean * FOOT, 33.83 * FOOT],
        rtol=1e-5,
    )
