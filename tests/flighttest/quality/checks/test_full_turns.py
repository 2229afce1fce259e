"""A bank angle that passes 180 deg is a roll, not a fault of the recorder."""

import numpy as np
import pytest
import xarray as xr

import flighttest

GRAVITY = 9.80665


def leaf(time, **channels):
    variables = {name: ("time", x) for name, x in channels.items()}
    return xr.Dataset(variables, {"time": time}, {"rate": 50.0})


@pytest.fixture
def rolling():
    """Two turns about the flight path at 0.9 rad/s, with the noise of the sensors."""
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 20.0, 0.02)
    edge = 0.5 + 0.5 * np.tanh(2.0 * (time - 3.0)) * -np.tanh(2.0 * (time - 17.0))
    rate = 0.9 * (2.0 * edge - 1.0).clip(0.0)
    bank = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * 0.02)])

    def noisy(x, level):
        return x + rng.normal(0.0, level, time.size)

    still = np.zeros_like(time)
    imu = leaf(
        time,
        p=noisy(rate, 2e-4),
        q=noisy(still, 2e-4),
        r=noisy(still, 2e-4),
        ax_imu=noisy(still, 5e-3),
        ay_imu=noisy(-GRAVITY * np.sin(bank), 5e-3),
        az_imu=noisy(-GRAVITY * np.cos(bank), 5e-3),
    )
    recorded = (noisy(bank, 1e-3) + np.pi) % (2.0 * np.pi) - np.pi
    attitude = leaf(time, phi=recorded, theta=noisy(still, 1e-3), psi=noisy(still, 1e-3))
    title = xr.Dataset(attrs={"title": "roll"})
    return xr.DataTree.from_dict({"/": title, "/imu": imu, "/attitude": attitude}), bank


def test_a_roll_is_no_finding(rolling):
    record, bank = rolling
    assert bank.max() > 4.0 * np.pi - 1.0
    findings = flighttest.assess(record).findings
    assert [item for item in findings if "phi" in item.channels] == []


@pytest.mark.slow
def test_a_bank_in_degrees_is_one(rolling):
    record, _ = rolling
    attitude = record["attitude"].to_dataset()
    record["attitude"] = attitude.assign(phi=np.rad2deg(attitude["phi"]))
    findings = flighttest.assess(record).findings
    assert {item.kind for item in findings if item.channels == ("phi",)} == {"unit"}
