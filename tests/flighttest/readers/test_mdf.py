import sys

import numpy as np
import pytest

import flighttest
from flightmech.errors import AeromatchError, ParseError

asammdf = pytest.importorskip("asammdf")
T = np.arange(200) / 50.0


@pytest.fixture
def log(tmp_path):
    file = asammdf.MDF(version="4.10")
    signals = [
        asammdf.Signal(np.sin(T), T, name="pitch_rate", unit="deg/s"),
        asammdf.Signal(3 * T, T, name="flap", unit="%"),
    ]
    file.append(signals, acq_name="fast")
    raw = asammdf.Signal(
        np.arange(40, dtype="u2"),
        np.arange(40) / 10.0,
        name="nz",
        unit="g",
        conversion={"a": 0.01, "b": -1.0},
    )
    file.append([raw], acq_name="slow")
    text = asammdf.Signal(
        np.array([b"a"] * 40), np.arange(40) / 10.0, name="word", encoding="utf-8"
    )
    file.append([text])
    file.save(tmp_path / "f.mf4", overwrite=True)
    file.close()
    return tmp_path / "f.mf4"


def names(tmp_path, text):
    (tmp_path / "n.toml").write_text(text)
    return tmp_path / "n.toml"


@pytest.mark.slow
def test_groups_are_tables_with_units_and_conversions(log, tmp_path):
    text = '[imu]\nq = "fast/pitch_rate"\n[air]\naz_imu = { column = "slow/nz", sign = -1 }\n'
    record = flighttest.read(log, names(tmp_path, text))
    np.testing.assert_allclose(record["imu/q"].values, np.radians(np.sin(T)))
    np.testing.assert_allclose(record["air/az_imu"].values, -9.80665 * (0.01 * np.arange(40) - 1.0))
    assert record["air"].attrs["rate"] == pytest.approx(10.0)
    assert record.attrs["format"] == "MDF"


@pytest.mark.slow
def test_channel_of_texts(log, tmp_path):
    with pytest.raises(ParseError, match="channel 'word' holding no numbers"):
        flighttest.read(
            log, names(tmp_path, '[a]\ngear = { column = "group2/word", unit = "1" }\n')
        )


@pytest.mark.slow
def test_damaged_file(log, tmp_path):
    log.write_bytes(log.read_bytes()[:300])
    with pytest.raises(ParseError, match=r"f\.mf4: found content that cannot be decoded"):
        flighttest.read(log, names(tmp_path, '[a]\nq = "fast/pitch_rate"\n'))


@pytest.mark.slow
def test_decoder_that_breaks_down_takes_only_its_own_process(log, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONFAULTHANDLER", "0")
    monkeypatch.setenv("AEROMATCH_FMU_SANDBOX", "none")  # which does not see the folder
    (tmp_path / "asammdf.py").write_text(
        "import os, signal\nos.kill(os.getpid(), signal.SIGABRT)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ParseError, match="bytes on which the decoder asammdf broke down"):
        flighttest.read(log, names(tmp_path, '[a]\nq = "fast/pitch_rate"\n'))


@pytest.mark.slow
def test_all_channels_without_a_map(log):
    tables = {
        table["table"]: [c["column"] for c in table["columns"]]
        for table in flighttest.records.contents(log)["tables"]
    }
    assert tables["fast"] == ["pitch_rate", "flap"]
    assert tables["slow"] == ["nz"]


def test_missing_package_error_states_how_to_install_it(log, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "asammdf", None)
    with pytest.raises(
        AeromatchError,
        match=r"needs the package asammdf; install it with: pip install 'aeromatch\[flight\]'",
    ):
        flighttest.read(log, names(tmp_path, '[a]\nq = "fast/pitch_rate"\n'))


@pytest.mark.slow
def test_texts_and_groups_of_one_sample_are_named(log, tmp_path):
    file = asammdf.MDF(log)
    file.append([asammdf.Signal(np.array([1.0]), np.array([0.0]), name="serial")], acq_name="once")
    file.save(tmp_path / "g.mf4", overwrite=True)
    file.close()
    found = {
        one["name"]: one["reason"]
        for one in flighttest.records.contents(tmp_path / "g.mf4")["left_out"]
    }
    assert found["once"] == "1 sample; a clock needs two samples"
    assert [reason for name, reason in found.items() if name.endswith("/word")] == ["text"]
