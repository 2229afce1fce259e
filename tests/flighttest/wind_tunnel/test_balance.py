"""Balance data: axes, moment reference, tare, errors and nuisance terms against a simulated tail
that shares no code with them.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parents[3] / "examples" / "flapping_vehicle"))
import tunnel

from flightmech.errors import AeromatchWarning, IdentificationError, SchemaError
from flighttest.cli.group import flight
from flighttest.records.readers.recording import RecordedTable, Recording
from flighttest.regression.equation_error.fit_file import open_fit
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.regression.model_structure.candidates import monomials
from flighttest.regression.model_structure.search import select_stepwise
from flighttest.special_tests.wind_tunnel.balance import read_setup
from flighttest.special_tests.wind_tunnel.points import _find_times
from flighttest.special_tests.wind_tunnel.reduction import (
    _warn_of_tare,
    balance_coefficients,
    without_nuisance,
)

WITHIN = 4.0  # standard errors: one estimate in 16 000 is outside by chance


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("tunnel")
    tunnel.main(path)
    return path


@pytest.fixture(scope="module")
def setup(folder):
    return read_setup(folder / "balance.toml")


@pytest.fixture(scope="module")
def data(folder, setup):
    return [balance_coefficients(folder / f"tail_{k}.csv", setup) for k in (1, 2)]


def test_without_noise_the_coefficients_are_those_of_the_simulation(tmp_path, setup, monkeypatch):
    monkeypatch.setattr(tunnel, "NOISE", 0.0)
    path = tmp_path / "quiet.csv"
    table = tunnel.record(3, 9.0)
    table.to_csv(path, index=False)
    found = balance_coefficients(path, setup)
    alpha, beta, strut = (found[name].values for name in ("alpha", "beta", "strut"))
    for name, terms, extra in (("CL", tunnel.CL, tunnel.STRUT * strut), ("CD", tunnel.CD, 0.0)):
        truth = (
            sum(value * tunnel._regressor(term, alpha, beta) for term, value in terms.items())
            + extra
        )
        assert found[name].values == pytest.approx(truth, abs=1e-9)
    assert np.abs(found["Cm"].values).max() < 1e-9  # all loads act at the moment reference point
    assert float(found["time"][0]) == 10.0  # points with the wind off are the tare


def test_a_tare_without_scatter_or_attitude_is_named():
    alpha = np.radians([0.0, 0.0, 4.0, 8.0])
    off = np.array([True, True, False, False])
    with pytest.warns(AeromatchWarning, match="go 8 deg beyond: the weight of the model"):
        _warn_of_tare(alpha, off, has_weight=False)
    _warn_of_tare(alpha, off, has_weight=True)
    with pytest.warns(AeromatchWarning, match="one point with the wind off has no scatter"):
        _warn_of_tare(alpha, np.array([True, False, False, False]), has_weight=True)


@pytest.mark.slow
def test_an_error_of_the_angle_moves_the_constant_of_the_lift(tmp_path, setup, monkeypatch):
    """The same points with the angle read one standard error too large: estimates change as the
    source states.
    """
    monkeypatch.setattr(tunnel, "NOISE", 0.0)
    model, fits = RegressionModel("CL", list(tunnel.CL)), []
    for name, error in (("right", 0.0), ("wrong", np.radians(0.1))):
        tunnel.record(3, 9.0, error).to_csv(tmp_path / f"{name}.csv", index=False)
        points = balance_coefficients(tmp_path / f"{name}.csv", setup)
        points["CL"] = points["CL"] - tunnel.STRUT * points["strut"]
        fits.append(regress(model, points).estimates)
    right, wrong = fits
    stated = right["systematic"].sel(error="alpha").values
    change = (wrong["estimate"] - right["estimate"]).values
    assert change == pytest.approx(stated, rel=0.1, abs=2e-5)
    assert abs(change[0]) > 0.0015  # CL_alpha times 0.1 deg is 0.002


@pytest.mark.slow
def test_the_true_terms_are_selected_and_lie_within_their_errors(data, setup):
    for name, truth in (("CL", tunnel.CL), ("CD", tunnel.CD)):
        candidates = monomials(["alpha", "beta"], 4)
        chosen = select_stepwise(
            name,
            candidates,
            without_nuisance(data, RegressionModel(name, candidates), setup),
            gain=0.0,
            hierarchy=False,
        )
        assert set(chosen.fit.model.terms) == set(truth)
        model = RegressionModel(name, list(truth))
        e = regress(model, without_nuisance(data, model, setup)).estimates
        for term, value in truth.items():
            row = e.sel(term=term)
            assert abs(float(row["estimate"]) - value) < WITHIN * float(
                np.hypot(row["stderr"], row["stderr_systematic"])
            )


@pytest.mark.nightly
@pytest.mark.parametrize(("k", "band"), [(1029, None), (1029, (0.05, 2.0)), (1002, (0.05, 2.0))])
def test_an_early_choice_is_exchanged_and_a_small_term_found(tmp_path, setup, k, band):
    """Entered alone, alpha**4 does better than alpha**3; in the band alpha**2*beta**2 adds 0.4 % of
    R2 with a partial F of 500.
    """
    draws, points = np.random.default_rng(k), []
    wrong = np.radians(0.1) * draws.standard_normal(), 0.05 * draws.standard_normal()
    for i, speed in enumerate((8.0, 11.0)):
        tunnel.record(100 + 2 * k + i, speed, *wrong).to_csv(tmp_path / "points.csv", index=False)
        points.append(balance_coefficients(tmp_path / "points.csv", setup))
    candidates = monomials(["alpha", "beta"], 4)
    chosen = select_stepwise(
        "CL",
        candidates,
        without_nuisance(points, RegressionModel("CL", candidates), setup),
        band,
        gain=0.0,
        hierarchy=False,
    )
    assert set(chosen.fit.model.terms) == set(tunnel.CL)


def test_nuisance_terms_taken_off_equal_those_in_the_fit(data, setup):
    model = RegressionModel("CL", list(tunnel.CL))
    X = np.concatenate([np.column_stack([model.design(one), one["strut"].values]) for one in data])
    z = np.concatenate([one["CL"].values for one in data])
    joint = np.linalg.lstsq(X, z, rcond=None)[0]
    fit = regress(model, without_nuisance(data, model, setup))
    assert fit.estimates["estimate"].values == pytest.approx(joint[:-1], rel=1e-9)
    v = z - X @ joint
    both = np.sqrt(
        float(v @ v) / (len(z) - X.shape[1]) * np.linalg.inv(X.T @ X)[:-1, :-1].diagonal()
    )
    alone = []
    for one in without_nuisance(data, model, setup):
        names = map(str, one["error"].values)
        alone.append(one.drop_sel(error=[n for n in names if not n.startswith("nuisance")]))
    e = regress(model, alone).estimates
    whole = np.hypot(e["stderr_white"].values, e["stderr_systematic"].values)
    assert whole == pytest.approx(both, rel=2e-3)  # degrees of freedom differ by one of 4000


def test_a_tare_that_only_the_airspeed_shows_is_found(folder, setup, tmp_path):
    import pandas as pd

    still = []
    for k in (1, 2):
        table = pd.read_csv(folder / f"tail_{k}.csv")
        path = tmp_path / f"{k}.csv"
        table[table["speed"] > 0.0].to_csv(
            path, index=False
        )  # nobody recorded a point with the wind off
        still.append(path)
    wanted = setup.model_copy(update={"nuisance": {"CD": ("tare",)}})
    data = [balance_coefficients(path, wanted) for path in still]
    model = RegressionModel("CD", ["1", "alpha", "alpha**2", "alpha**3"])
    with_tare = regress(model, without_nuisance(data, model, wanted)).estimates["stderr_systematic"]
    assert float(with_tare.sel(term="1")) > 0.0
    with pytest.raises(IdentificationError, match="vary airspeed"):
        without_nuisance(data[:1], model, wanted)  # one airspeed


def test_a_balance_fixed_in_the_tunnel_needs_no_turn_by_the_model(tmp_path, setup):
    alpha = np.radians([0.0, 5.0, 10.0])
    path = tmp_path / "fixed.csv"
    rows = [
        f"{np.degrees(a)},20,{-1.0},{0.0},{-10.0}" for a in alpha
    ]  # drag 1 N, lift 10 N in tunnel axes
    path.write_text("alpha,V,Fx,Fy,Fz\n" + "\n".join(rows) + "\n", encoding="utf-8")
    fixed = setup.model_copy(
        update={
            "columns": {"alpha": "alpha [deg]"},
            "balance": setup.balance.model_copy(update={"moves": False, "rotation": (0.0,) * 3}),
        }
    )
    found = balance_coefficients(path, fixed)
    qS = 0.5 * 1.2 * 400.0 * 0.032
    assert found["CL"].values == pytest.approx(10.0 / qS)
    assert found["CD"].values == pytest.approx(1.0 / qS)
    assert "Cm" not in found  # no moment was measured
    assert found["time"].values.tolist() == [0.0, 1.0, 2.0]


def test_the_clock_is_read_from_the_table_that_has_it():
    """The first table has no clock, and the second one has a clock of other samples."""
    loads = RecordedTable({"alpha": np.zeros(3)})
    slow = RecordedTable({"time": np.array([7.0, 8.0])})
    times = RecordedTable({"time": np.array([10.0, 12.0, 15.0])})
    recording = Recording("hdf5", {"loads": loads, "slow": slow, "times": times})
    assert _find_times(recording, 3).tolist() == [10.0, 12.0, 15.0]
    assert _find_times(recording, 4).tolist() == [0.0, 1.0, 2.0, 3.0]


def test_bad_input_is_refused(tmp_path, folder, setup):
    path = tmp_path / "points.csv"
    path.write_text("time,alpha,Fz\n0,1,2\n1,2,3\n", encoding="utf-8")
    plain = setup.model_copy(update={"columns": {}})
    with pytest.raises(SchemaError, match="no column of V or qbar"):
        balance_coefficients(path, plain)
    path.write_text("time,alpha,V,Fz\n0,1,0,2\n1,2,0,3\n", encoding="utf-8")
    with pytest.raises(IdentificationError, match="with the wind on"):
        balance_coefficients(path, plain)
    bad = tmp_path / "bad.toml"
    bad.write_text(
        '[reference]\nS = "1 m2"\nb = "1 m"\nc = "1 m"\n[errors]\nFq = "1 N"\n[nuisance]\nCQ '
        '= ["tare"]\n',
        encoding="utf-8",
    )
    with pytest.raises(SchemaError, match="Fq"):
        read_setup(bad)


@pytest.mark.nightly
def test_the_fits_are_drawn_over_both_angles(data, setup, tmp_path):
    from flighttest.special_tests.wind_tunnel.surfaces import draw_surfaces

    fits = [regress(RegressionModel(name, ["1", "alpha"]), data) for name in ("CL", "CD")]
    fits.append(
        regress(RegressionModel("CL", ["1", "beta"]), [one.drop_vars("alpha") for one in data])
    )
    draw_surfaces(fits, tmp_path / "tail.svg")
    text = (tmp_path / "tail.svg").read_text(encoding="utf-8")
    assert "<svg" in text[:1000]
    with pytest.raises(SchemaError, match=r"tail\.txt"):
        draw_surfaces(fits, tmp_path / "tail.txt")


@pytest.mark.nightly
def test_the_verb_writes_fits_for_the_database(folder, tmp_path):
    words = [
        "balance",
        str(folder / "tail_1.csv"),
        str(folder / "tail_2.csv"),
        "--setup",
        str(folder / "balance.toml"),
    ]
    done = CliRunner().invoke(
        flight,
        [
            *words,
            "--select",
            "CL",
            "--model",
            "CD = 1 + alpha**2",
            "--band",
            "0.05",
            "2",
            "-o",
            str(tmp_path / "fits"),
        ],
    )
    assert done.exit_code == 0, done.output
    assert set(open_fit(tmp_path / "fits" / "CL.nc").model.terms) == set(tunnel.CL)
    assert open_fit(tmp_path / "fits" / "CD.nc").model.terms == ("1", "alpha**2")
    assert "average 1/s" in done.output
    nothing = CliRunner().invoke(flight, words)
    assert isinstance(nothing.exception, SchemaError)


@pytest.mark.slow
def test_the_verb_chooses_in_frequency(folder):
    words = [
        "balance",
        str(folder / "tail_1.csv"),
        str(folder / "tail_2.csv"),
        "--setup",
        str(folder / "balance.toml"),
        "--select",
        "CL",
    ]
    done = CliRunner().invoke(
        flight,
        [
            *words,
            "--select-in",
            "frequency",
            "--band",
            "0.05",
            "2",
            "--weights",
            "spectrum",
            "--json",
        ],
    )
    assert done.exit_code == 0, done.output
    assert set(json.loads(done.output)["fits"]["CL"]) == set(tunnel.CL)
    without = CliRunner().invoke(flight, [*words, "--select-in", "frequency"])
    assert without.exit_code == 2
    assert "--select-in frequency needs --band" in without.output
