"""The listings of the Citation-500-like aeroplane: database, sanity of its derivatives, trim, FMU.

Expected numbers: table "Sanity of the numbers" in the README of the corpus, Mach 0.15, sea level,
alpha 8 deg.  Its lateral derivatives are printed in stability axes; here they are turned into body
axes by hand.
"""

from pathlib import Path

import fmpy
import numpy as np
import pytest

import aerodb
import flightmech
from flightmech import terms
from flightmech.errors import SchemaError
from flightmech.units import G0

ALPHA = np.radians(8.0)
SIN, COS = np.sin(ALPHA), np.cos(ALPHA)
POINT = {"alpha": ALPHA, "mach": 0.15}
# stability axes, per radian and per p b/2V
Cl_beta, Cn_beta = -0.067, 0.099
Cl_p, CY_p, Cn_p, Cl_r, Cn_r = -0.493, -0.121, -0.074, 0.178, -0.172
DERIVATIVES = {
    "CL/qhat": 2 * 3.86,  # the README gives them per q c/V
    "Cm/qhat": 2 * -8.34,
    "CL/alphadothat": 2 * 1.78,
    "Cm/alphadothat": 2 * -4.84,
    "CY/beta": -0.779,
    "Cl/beta": Cl_beta * COS - Cn_beta * SIN,
    "Cn/beta": Cl_beta * SIN + Cn_beta * COS,
    "CY/phat": CY_p * COS,  # CY_r has no method
    "Cl/phat": Cl_p * COS**2 - (Cl_r + Cn_p) * SIN * COS + Cn_r * SIN**2,
    "Cn/phat": Cn_p * COS**2 + (Cl_p - Cn_r) * SIN * COS - Cl_r * SIN**2,
    "Cl/rhat": Cl_r * COS**2 + (Cl_p - Cn_r) * SIN * COS - Cn_p * SIN**2,
    "Cn/rhat": Cn_r * COS**2 + (Cl_r + Cn_p) * SIN * COS + Cl_p * SIN**2,
}


def table(db, name, **conditions):
    """Return the table of a term without its regressor."""
    leaf = db[name].to_dataset()
    regressor = dict.fromkeys(terms.list_regressors(leaf), 1.0)
    return float(terms.evaluate_term(leaf, {**POINT, **regressor, **conditions}))


@pytest.mark.slow
def test_database_is_sound_and_states_what_datcom_lacks(ce500_db):
    assert aerodb.check(ce500_db) == []
    assert {"CY/rudder", "Cn/rudder", "CL/gear", "CY/rhat"} <= set(ce500_db.attrs["absent"].split())
    assert "ce500_elevator.out, lines" in ce500_db["Cm/elevator"].attrs["references"]


@pytest.mark.parametrize("name", DERIVATIVES)
def test_derivative(ce500_db, name):
    # half a unit of the README's last digit: twice that for the doubled rates of pitch, up to three
    # of them through the turn of axes
    assert table(ce500_db, name) == pytest.approx(
        DERIVATIVES[name], abs=0.011 if name.startswith(("CL", "Cm")) else 0.0015
    )


def test_slopes_of_lift_and_moment(ce500_db):
    def slope(name):
        return (
            table(ce500_db, name, alpha=np.radians(10.0))
            - table(ce500_db, name, alpha=np.radians(6.0))
        ) / np.radians(4.0)

    # README: 6.28 and -0.55, the program's own slopes by its three-point rule; 2 % for the coarse
    # alphas
    assert slope("CL/basic") == pytest.approx(6.28, rel=0.02)
    assert slope("Cm/basic") == pytest.approx(-0.55, rel=0.03)


def test_elevator_power(ce500_db):
    up, down = (
        table(ce500_db, "Cm/elevator", mach=0.2, delta_e=np.radians(angle)) for angle in (-5.0, 5.0)
    )
    assert (down - up) / np.radians(10.0) == pytest.approx(-1.99, abs=0.005)


def test_flap_lift(ce500_db):
    for degrees, lift in ((15.0, 0.272), (40.0, 0.579)):
        assert table(ce500_db, "CL/flap", delta_f=np.radians(degrees)) == pytest.approx(
            lift, abs=5e-4
        )


def test_cases_of_unlike_flaps_are_not_joined(ce500, listings):
    with pytest.raises(SchemaError, match="delta differs from that of the first tree"):
        aerodb.from_datcom(ce500, clean=listings["clean"], flaps=listings["flaps"])


@pytest.mark.nightly
def test_cruise_trim_and_fmu(ce500, ce500_db, tmp_path):
    sim = flightmech.compile(ce500, ce500_db)
    cruise = {"init.V": 130.0, "init.h": 6000.0, "mode.engine": 2.0, "mode.earth": 0.0}
    trimmed = flightmech.trim(sim, cruise)
    weight = ce500.mass * G0
    lift = float(trimmed["CL"] * trimmed["qbar"]) * ce500.S
    thrust = float(trimmed["engine1.thrust"] + trimmed["engine2.thrust"])
    assert lift + thrust * np.sin(float(trimmed["alpha"])) == pytest.approx(weight, rel=1e-6)
    assert abs(float(trimmed["trim.q_dot"])) < 1e-9
    assert np.degrees(float(trimmed["applied.delta_e"])) == pytest.approx(0.0, abs=3.0)

    file = flightmech.write_fmu(sim, Path(tmp_path) / "ce500.fmu")
    start = {**cruise, "mode.trim": 1.0}
    flown = fmpy.simulate_fmu(
        str(file),
        stop_time=10.0,
        output_interval=0.1,
        start_values=start,
        output=["V", "theta", "h"],
    )
    np.testing.assert_allclose(flown["V"], 130.0, atol=0.01)
    np.testing.assert_allclose(flown["theta"], float(trimmed["theta"]), atol=1e-4)
    np.testing.assert_allclose(flown["h"], 6000.0, atol=0.05)
