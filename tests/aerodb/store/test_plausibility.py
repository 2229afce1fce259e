"""Tests of the signs and sizes that a reader of a database would question."""

import dataclasses

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

import aerodb
from aerodb.cli.group import db as group
from aerodb.store.plausibility import check_plausibility
from flightmech.errors import AeromatchWarning, SchemaError
from flightmech.terms import make_term
from flightmech.units import DEGREE

ALPHA = np.radians([-8.0, 0.0, 8.0, 16.0])
MACH = [0.2, 0.4]
DELTA = np.radians([-20.0, 0.0, 20.0])


@pytest.fixture
def aeroplane(root) -> xr.DataTree:
    """Return a database with the derivatives of an ordinary light aeroplane."""

    def over_alpha(offset: float, slope: float) -> xr.Dataset:
        table = offset + np.outer([1.0, 1.05], slope * ALPHA)
        return make_term(table, {"mach": MACH, "alpha": ALPHA}, stderr=0.01)

    leaves = {
        "CL/basic": over_alpha(0.2, 4.9),
        "CD/basic": over_alpha(0.03, 0.0),
        "Cm/basic": over_alpha(0.02, -0.7),
        "Cm/qhat": make_term(-15.0, regressors=["qhat"]),
        "CL/qhat": make_term(7.0, regressors=["qhat"]),
        "CY/beta": make_term(-0.5, regressors=["beta"]),
        "Cl/beta": make_term(-0.1, regressors=["beta"]),
        "Cn/beta": make_term(0.08, regressors=["beta"]),
        "Cl/phat": make_term(-0.45, regressors=["phat"]),
        "Cl/rhat": make_term(0.1, regressors=["rhat"]),
        "Cn/rhat": make_term(-0.12, regressors=["rhat"]),
        "Cm/elevator": make_term(-1.2 * DELTA, {"delta_e": DELTA}),
        "Cl/aileron": make_term(-0.15 * DELTA, {"delta_a": DELTA}),
        "Cn/rudder": make_term(-0.09, regressors=["delta_r"]),
    }
    return aerodb.make_database(leaves, **{**root, "absent": ""})


@dataclasses.dataclass(frozen=True)
class Mass:
    """The part of an aircraft that is checked."""

    mass: float
    cg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    limits: dict[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    x_ref_mac: float = 0.25


def subjects(found) -> set[str]:
    return {item.subject for item in found if item.stops}


def test_an_ordinary_aeroplane_is_plausible(aeroplane) -> None:
    found = check_plausibility(aeroplane, Mass(1200.0))
    assert [str(item) for item in found] == []


def test_what_was_not_checked_is_listed(aeroplane) -> None:
    (found,) = check_plausibility(aeroplane)
    assert (found.subject, found.kind, found.stops) == ("manoeuvre margin", "not checked", False)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("term", "factor", "subject"),
    [("Cm/elevator", -1.0, "Cm/delta_e"), ("Cn/rudder", 57.3, "Cn/delta_r")],
)
def test_a_control_of_the_wrong_sign_is_called_one(aeroplane, term, factor, subject) -> None:
    aeroplane[term]["value"][...] *= factor
    (item,) = [item for item in check_plausibility(aeroplane) if item.subject == subject]
    as_sign = f"the sign of the control {subject.split('/')[1]} of its source is wrong"
    assert (as_sign in str(item)) == (factor == -1.0)


@pytest.mark.parametrize(
    ("term", "factor", "subject"),
    [
        ("Cm/qhat", -1.0, "Cm/qhat"),
        ("Cm/qhat", 27.0, "Cm/qhat"),
        ("Cn/beta", -1.0, "Cn/beta"),
        ("Cl/phat", -1.0, "Cl/phat"),
        ("Cl/aileron", -1.0, "Cl/delta_a"),
        ("Cm/elevator", -1.0, "Cm/delta_e"),
        ("Cn/rudder", 57.3, "Cn/delta_r"),
        ("CL/basic", 57.3, "CL/alpha"),
        ("CL/basic", 0.3, "CL/alpha"),
        ("Cm/basic", -1.0, "static margin"),
        ("CD/basic", 0.0, "CD"),
        ("CD/basic", 20.0, "CD"),
    ],
)
def test_a_wrong_sign_or_size_is_named(aeroplane, term: str, factor: float, subject: str) -> None:
    aeroplane[term]["value"][...] *= factor
    found = check_plausibility(aeroplane)
    assert subject in subjects(found)
    (item,) = [item for item in found if item.subject == subject]
    assert item.place == "every Mach number"
    assert item.source


def test_alpha_dot_of_a_supersonic_wing_has_either_sign(aeroplane) -> None:
    """Digital DATCOM prints CMAD from -0.5 to +0.3 for a swept fighter at Mach 1.6 and 2."""
    values = np.outer([-5.0, 0.3], np.ones(4))
    leaf = make_term(
        values, {"mach": [0.2, 1.6], "alpha": ALPHA}, regressors=["alphadothat"], stderr=0.1
    )
    aeroplane["Cm/alphadothat"] = xr.DataTree(leaf)
    # the tables of the lift give the Mach numbers
    for name in ("CL/basic", "CD/basic", "Cm/basic"):
        table = aeroplane[name].to_dataset().assign_coords(mach=[0.2, 1.6])
        aeroplane[name] = xr.DataTree(table)
    assert "Cm/alphadothat" not in subjects(check_plausibility(aeroplane))
    aeroplane["Cm/alphadothat"]["value"][...] *= -1.0
    found = {item.subject: item for item in check_plausibility(aeroplane)}
    assert found["Cm/alphadothat"].place == "Mach 0.2"


def test_one_wrong_mach_number_is_named(aeroplane) -> None:
    aeroplane["Cm/basic"]["value"][1] *= -1.0
    (item,) = [item for item in check_plausibility(aeroplane) if item.stops]
    assert (item.subject, item.place) == ("static margin", "Mach 0.4")


def test_a_wrong_chord_is_named(aeroplane) -> None:
    aeroplane.attrs["cbar"] = 0.3048 * aeroplane.attrs["cbar"]
    assert "reference lengths" in subjects(check_plausibility(aeroplane))


def test_one_angle_of_attack_is_no_database(small_terms, root) -> None:
    leaf = small_terms["CL/basic"].isel(alpha=[1])
    tree = aerodb.make_database({"CL/basic": leaf}, **root)
    assert "angles of attack" in subjects(check_plausibility(tree))


def test_an_aeroplane_that_damping_alone_makes_unstable(aeroplane) -> None:
    """The manoeuvre margin needs the mass: h_m = h_n - (rho S cbar / 4 m) Cm_qhat."""
    light = check_plausibility(aeroplane, Mass(1200.0))
    assert not light
    aeroplane["Cm/basic"]["value"][...] *= -1.0
    aeroplane["Cm/qhat"]["value"][...] *= 0.1
    found = check_plausibility(aeroplane, Mass(1200.0))
    assert {"static margin", "manoeuvre margin"} <= subjects(found)


def test_margins_are_about_the_centre_of_gravity(aeroplane) -> None:
    """0.5 m aft of the reference point is 0.3 of the chord of 1.667 m; the margin was 0.14."""
    assert check_plausibility(aeroplane, Mass(1200.0, cg=(0.2, 0.0, 0.0))) == []
    (item,) = check_plausibility(aeroplane, Mass(1200.0, cg=(-0.3, 0.0, 0.0)))
    assert item.subject == "static margin"
    assert item.value == pytest.approx(0.7 / 4.9 - 0.3 / 1.667, abs=2e-3)


def test_degrees_and_percent_in_an_aircraft_file(aeroplane) -> None:
    travel = {"delta_e": (-20.0, 17.0), "delta_a": (-0.3, 0.3), "delta_s": (0.0, 5.0)}
    found = check_plausibility(aeroplane, Mass(1200.0, limits=travel, x_ref_mac=27.0))
    assert subjects(found) == {"limits delta_e", "x_ref_mac"}


def test_a_coefficient_without_terms(aeroplane) -> None:
    del aeroplane["CD"]
    assert subjects(check_plausibility(aeroplane)) == {"CD"}
    del aeroplane["CY"]
    kinds = {item.subject: item.kind for item in check_plausibility(aeroplane)}
    assert kinds["CY"] == "missing"


@pytest.mark.nightly
def test_an_acknowledged_finding_keeps_its_reason(aeroplane, tmp_path) -> None:
    aeroplane["Cm/basic"]["value"][...] *= -1.0
    aerodb.save(aeroplane, tmp_path / "x.nc")
    text = 'name = "x"\nS = 16.9\ncbar = 1.667\nb = 10.31\nmass = 1200.0\nIxx = 1.0\nIyy = 1.0\n'
    text += "Izz = 1.0\n"
    reason = '[acknowledged]\n"static margin" = "relaxed stability, stabilised by a computer"\n'
    manoeuvre = '"manoeuvre margin" = "relaxed stability, stabilised by a computer"\n'
    (tmp_path / "plain.toml").write_text(text)
    (tmp_path / "reason.toml").write_text(text + reason + manoeuvre)
    (tmp_path / "short.toml").write_text(text + '[acknowledged]\n"static margin" = "ok"\n')

    def check(aircraft: str):
        arguments = ["check", str(tmp_path / "x.nc"), "--aircraft", str(tmp_path / aircraft)]
        return CliRunner().invoke(group, arguments)

    assert check("plain.toml").exit_code == 1
    accepted = check("reason.toml")
    assert accepted.exit_code == 0
    assert "acknowledged: relaxed stability, stabilised by a computer" in accepted.stdout
    assert "acknowledged.static margin" in str(check("short.toml").exception)


def test_an_acknowledgement_of_no_finding_is_reported(aeroplane) -> None:
    aeroplane["Cm/qhat"]["value"][...] = -130.0
    reason = "measured twice in free flight"
    (finding, unused) = check_plausibility(
        aeroplane, Mass(1200.0), {"Cm/qhat": reason, "static magrin": reason}
    )
    assert finding.reason == reason
    assert unused.kind == "unused"
    assert not unused.stops
    assert "'static magrin'" in str(unused)
    assert "subjects are: Cm/qhat;" in str(unused)


@pytest.mark.parametrize("reason", ["", "   "])
def test_an_acknowledgement_needs_a_reason(aeroplane, reason) -> None:
    with pytest.raises(SchemaError, match="static margin: no reason is given"):
        check_plausibility(aeroplane, Mass(1200.0), {"static margin": reason})


@pytest.mark.slow
def test_check_prints_an_acknowledgement_of_no_finding(aeroplane, tmp_path) -> None:
    aerodb.save(aeroplane, tmp_path / "x.nc")
    text = 'name = "x"\nS = 16.9\ncbar = 1.667\nb = 10.31\nmass = 1200.0\nIxx = 1.0\nIyy = 1.0\n'
    text += 'Izz = 1.0\n[acknowledged]\n"Cm/qhatt" = "'
    (tmp_path / "x.toml").write_text(text + 'measured twice in free flight"\n')
    (tmp_path / "blank.toml").write_text(text + " " * 20 + '"\n')
    (tmp_path / "dots.toml").write_text(text + "." * 20 + '"\n')
    command = ["check", str(tmp_path / "x.nc"), "--aircraft"]
    shown = CliRunner().invoke(group, [*command, str(tmp_path / "x.toml")])
    assert shown.exit_code == 0
    assert "the acknowledgement of 'Cm/qhatt' is unused" in shown.stdout
    for name in ("blank.toml", "dots.toml"):
        refused = CliRunner().invoke(group, [*command, str(tmp_path / name)])
        assert "acknowledged.Cm/qhatt" in str(refused.exception)


def test_a_body_axes_database_is_checked(aeroplane, root) -> None:
    """CL and CD come from CX and CZ."""
    leaves = {
        "CZ/basic": make_term(-0.2 - 4.9 * ALPHA, {"alpha": ALPHA}),
        "CX/basic": make_term(-0.03 + 0.0 * ALPHA, {"alpha": ALPHA}),
        "Cm/basic": make_term(0.02 + 0.7 * ALPHA, {"alpha": ALPHA}),
    }
    tree = aerodb.make_database(leaves, **{**root, "absent": "", "force_axes": "body"})
    assert subjects(check_plausibility(tree)) == {"static margin"}


@pytest.mark.nightly
def test_build_warns_of_an_implausible_database(make_case, craft) -> None:
    alpha = np.radians(np.arange(-8.0, 17.0, 2.0))
    aircraft = dataclasses.replace(craft, S=16.0, cbar=1.6, b=10.0, reference=(-3.0, 0.0, 0.0))
    with pytest.warns(AeromatchWarning, match="static margin = -0.2 is implausible"):
        tree = aerodb.from_datcom(aircraft, clean=make_case(Cm=0.05 + 1.0 * alpha))
    assert "static margin = -0.2 is implausible" in tree.attrs["notices"]
    assert np.isclose(alpha[1] - alpha[0], 2.0 * DEGREE)


def over_mach(values: list[float], machs: list[float], **more) -> xr.DataTree:
    table = np.outer(values, np.ones(4))
    return xr.DataTree(make_term(table, {"mach": machs, "alpha": ALPHA}, stderr=0.1, **more))


def test_a_lift_that_ends_below_the_other_coefficients_is_named(aeroplane) -> None:
    """Tables to Mach 5 for Cm, and a print that has lift up to 0.6 only."""
    table = aeroplane["Cm/basic"].to_dataset().assign_coords(mach=[0.2, 5.0])
    aeroplane["Cm/basic"] = xr.DataTree(table)
    found = subjects(check_plausibility(aeroplane))
    assert {"CL/mach", "CD/mach"} <= found
    assert "Cm/mach" not in found


def test_a_pitch_damping_that_jumps_is_named(aeroplane) -> None:
    aeroplane["Cm/qhat"] = over_mach([-15.0, -40.0], MACH, regressors=["qhat"])
    assert "Cm/qhat over Mach" not in subjects(check_plausibility(aeroplane))
    aeroplane["Cm/qhat"] = over_mach([-10.0, -40.0], MACH, regressors=["qhat"])
    assert subjects(check_plausibility(aeroplane)) == {"Cm/qhat over Mach"}


def test_slopes_are_taken_where_the_tables_are(aeroplane) -> None:
    """Tables from 0 to 16 deg: from -4 deg on the slope would contain held values."""
    for name in ("CL/basic", "CD/basic", "Cm/basic"):
        leaf = aeroplane[name].to_dataset().isel(alpha=slice(1, None))
        aeroplane[name] = xr.DataTree(leaf)
    assert subjects(check_plausibility(aeroplane)) == set()
    for name in ("CL/basic", "CD/basic", "Cm/basic"):
        leaf = aeroplane[name].to_dataset().isel(alpha=slice(1, None))
        aeroplane[name] = xr.DataTree(leaf)
    found = {item.subject: item.kind for item in check_plausibility(aeroplane)}
    for subject in ("CL/alpha", "CD", "static margin", "manoeuvre margin"):
        assert found[subject] == "not checked"


def test_a_root_chord_in_place_of_the_mean_one_is_named(aeroplane) -> None:
    """Of a wing of taper ratio 0.34 it is 1.49 times the area over the span."""
    S, b = (float(aeroplane.attrs[name]) for name in ("S", "b"))
    aeroplane.attrs["cbar"] = 1.33 * S / b
    assert subjects(check_plausibility(aeroplane)) == set()
    aeroplane.attrs["cbar"] = 1.49 * S / b
    assert "reference lengths" in subjects(check_plausibility(aeroplane))


# Configurations of Digital DATCOM and values that are right for them alone.
@pytest.mark.nightly
@pytest.mark.parametrize(
    ("configuration", "values"),
    [
        ("WING-BODY-VERTICAL TAIL", {"Cm/qhat": -0.9, "CL/qhat": 0.8, "Cm/elevator": -0.15}),
        ("WING-BODY-VERTICAL TAIL", {"Cn/beta": 0.004, "Cn/rhat": -0.01}),
        ("WING-BODY-HORIZONTAL TAIL", {"Cn/beta": 0.0016, "CY/beta": -0.04, "Cn/rhat": -0.001}),
        ("WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL (canard)", {"CL/qhat": -2.0, "Cm/elevator": 1.2}),
        ("WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL (rear wing)", {"CL/qhat": 0.1}),
    ],
)
def test_ranges_follow_the_configuration(aeroplane, configuration: str, values) -> None:
    for name, value in values.items():
        leaf = make_term(value, regressors=[name.split("/")[1].replace("elevator", "delta_e")])
        aeroplane[name] = xr.DataTree(leaf)
    assert subjects(check_plausibility(aeroplane)) == {
        name.replace("elevator", "delta_e") for name in values
    }
    aeroplane.attrs["configuration"] = configuration
    assert subjects(check_plausibility(aeroplane)) == set()


@pytest.mark.parametrize(
    ("configuration", "name", "value"),
    [
        ("WING-BODY-VERTICAL TAIL", "Cm/qhat", 0.5),
        ("WING-BODY-VERTICAL TAIL", "Cn/rhat", 0.01),
        ("WING-BODY-HORIZONTAL TAIL", "Cn/beta", -0.02),
        ("WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL (canard)", "Cm/delta_e", -1.2),
    ],
)
def test_a_wrong_sign_of_an_unusual_configuration(aeroplane, configuration, name, value) -> None:
    coefficient, variable = name.split("/")
    aeroplane[f"{coefficient}/{variable.replace('delta_e', 'elevator')}"] = xr.DataTree(
        make_term(value, regressors=[variable])
    )
    aeroplane.attrs["configuration"] = configuration
    assert name in subjects(check_plausibility(aeroplane))


def test_roll_due_to_sideslip_of_a_low_wing_is_about_zero(aeroplane) -> None:
    aeroplane["Cl/beta"] = xr.DataTree(make_term(0.01, regressors=["beta"]))
    assert subjects(check_plausibility(aeroplane)) == set()
    aeroplane["Cl/beta"] = xr.DataTree(make_term(0.1, regressors=["beta"]))
    assert subjects(check_plausibility(aeroplane)) == {"Cl/beta"}


def test_derivatives_of_a_supersonic_aeroplane_are_smaller(aeroplane) -> None:
    """The print of a fighter at Mach 2.5 has Cm_qhat of -2.3; a third of the published -3.7 is
    -1.24.
    """
    for name in ("CL/basic", "CD/basic", "Cm/basic"):
        table = aeroplane[name].to_dataset().assign_coords(mach=[0.2, 3.0])
        if name == "CL/basic":
            table["value"][1] *= 0.28  # 4 / sqrt(M^2 - 1)
        if name == "Cm/basic":
            table["value"][1] *= 0.28
        aeroplane[name] = xr.DataTree(table)
    aeroplane["Cm/qhat"] = over_mach([-4.0, -0.6], [0.2, 3.0], regressors=["qhat"])
    assert "Cm/qhat" not in subjects(check_plausibility(aeroplane))
    aeroplane["Cm/qhat"] = over_mach([-4.0, -0.4], [0.2, 3.0], regressors=["qhat"])
    assert "Cm/qhat" in subjects(check_plausibility(aeroplane))
    aeroplane["Cm/qhat"] = over_mach([-0.6, -4.0], [0.2, 3.0], regressors=["qhat"])
    assert "Cm/qhat" in subjects(check_plausibility(aeroplane))


def test_an_aeroplane_that_no_elevator_can_trim(aeroplane) -> None:
    """20 deg of elevator give 0.42, and the slope -0.7 another 0.07 over the attached angles."""
    aeroplane["Cm/basic"]["value"][...] += 0.38
    assert "trim" not in subjects(check_plausibility(aeroplane))
    aeroplane["Cm/basic"]["value"][...] += 0.15
    (item,) = [item for item in check_plausibility(aeroplane) if item.subject == "trim"]
    # 0.02 + 0.38 + 0.15 - 1.2 20 deg - 0.7 6 deg
    assert item.value == pytest.approx(0.55 - (24.0 + 4.2) * DEGREE, abs=5e-3)
    assert "delta_e -20 to 20 deg" in item.source


def test_roll_due_to_yaw_is_small_at_low_lift(aeroplane) -> None:
    aeroplane["Cl/rhat"] = xr.DataTree(make_term(0.01, regressors=["rhat"]))
    assert subjects(check_plausibility(aeroplane)) == {"Cl/rhat"}
    # The lift at 2 deg is 0.371; without camber it is 0.171.
    aeroplane["CL/basic"]["value"][...] -= 0.2
    assert subjects(check_plausibility(aeroplane)) == set()
    aeroplane["Cl/rhat"] = xr.DataTree(make_term(-0.05, regressors=["rhat"]))
    assert subjects(check_plausibility(aeroplane)) == {"Cl/rhat"}


def test_a_small_pitch_damping_of_unknown_surfaces_names_the_tailless_range(aeroplane) -> None:
    aeroplane["Cm/qhat"]["value"][...] = -0.9
    (item,) = [item for item in check_plausibility(aeroplane) if item.subject == "Cm/qhat"]
    assert item.stops
    assert "Without horizontal tail -15 to -0.25 is usual" in item.source
    assert '"Cm/qhat" = "no horizontal tail: ..."' in item.source
    # a value that no aircraft has, and a deck that states the surfaces, get no such words
    aeroplane["Cm/qhat"]["value"][...] = 0.5
    (item,) = [item for item in check_plausibility(aeroplane) if item.subject == "Cm/qhat"]
    assert "horizontal tail" not in item.source
    aeroplane.attrs["configuration"] = "WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL"
    aeroplane["Cm/qhat"]["value"][...] = -0.9
    (item,) = [item for item in check_plausibility(aeroplane) if item.subject == "Cm/qhat"]
    assert "Without horizontal tail" not in item.source
