import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
from recorders import chapter10

import flighttest
from flightmech.errors import UnknownName
from flighttest.records.readers.arinc429 import Words, label_tables, label_values, odd_parity
from flighttest.records.readers.bus_words import Arinc429, Arinc429Label


def words(*values):
    return np.array(values, np.uint32)


def test_word_put_together_by_hand():
    # label 203 octal, 25 000 ft of 131 072 ft in 17 bits: count 25 000, positive, SSM 11, data bits
    # 28 ... 12
    word = 0o203 | 25_000 << 11 | 0b11 << 29
    word |= (1 - bin(word).count("1") % 2) << 31
    assert odd_parity(words(word)).all()
    altitude = Arinc429Label(label="203", code="bnr", bits=17, range=131072.0, unit="ft")
    assert label_values(words(word), altitude).tolist() == [25_000.0]


@pytest.mark.parametrize(("bits", "scale"), [(15, 2048.0), (14, 180.0), (12, 4.0), (17, 131072.0)])
@pytest.mark.parametrize("share", [0.0, 0.3, -0.3, 0.999, -1.0])
def test_bnr_there_and_back_within_half_a_count(bits, scale, share):
    word = chapter10.bnr(0o101, bits, scale, share * scale)
    found = label_values(
        words(word), Arinc429Label(label="101", code="bnr", bits=bits, range=scale)
    )
    assert found[0] == pytest.approx(share * scale, abs=0.5001 * scale / (1 << bits))


@pytest.mark.parametrize(("digits", "value"), [(5, 79_999), (4, 1013), (3, -125), (1, 7)])
def test_bcd_there_and_back(digits, value):
    label = Arinc429Label(label="235", code="bcd", digits=digits, resolution=0.1)
    assert label_values(words(chapter10.bcd(0o235, digits, value)), label)[0] == pytest.approx(
        0.1 * value
    )


def test_bcd_digit_above_nine_is_no_value():
    word = 0o235 | 0xB << 22
    assert np.isnan(
        label_values(words(word), Arinc429Label(label="235", code="bcd", digits=2, resolution=1.0))
    ).all()


@pytest.mark.parametrize("ssm", [0, 1, 2])
def test_bnr_that_is_not_in_normal_operation_is_no_value(ssm):
    word = chapter10.bnr(0o210, 15, 2048.0, 250.0, ssm=ssm)
    assert np.isnan(
        label_values(words(word), Arinc429Label(label="210", code="bnr", bits=15, range=2048.0))
    ).all()


def test_discrete_bit():
    label = Arinc429Label(label="350", code="discrete", bit=11)
    assert label_values(
        words(chapter10.discrete(0o350, 11, True), chapter10.discrete(0o350, 12, True)), label
    ).tolist() == [1.0, 0.0]


def spec(labels="octal", **parameters):
    return Arinc429(kind="arinc429", labels=labels, channel=1, parameters=parameters)


TAS = Arinc429Label(label="210", code="bnr", bits=15, range=2048.0, unit="kt")


def test_labels_sources_and_parity_are_distinguished():
    good = [
        chapter10.bnr(0o210, 15, 2048.0, 250.0, sdi=1),
        chapter10.bnr(0o210, 15, 2048.0, 251.0, sdi=2),
        chapter10.bnr(0o206, 14, 1024.0, 200.0),
    ]
    broken = chapter10.bnr(0o210, 15, 2048.0, 999.0, sdi=1) ^ 1 << 31
    stream = Words(np.arange(4.0), words(*good, broken))
    tables, notes = label_tables(stream, spec(tas=TAS.model_copy(update={"sdi": 1})), "adc")
    assert tables["adc.tas"].columns["value"].tolist() == [250.0]
    assert tables["adc.tas"].time.tolist() == [0.0]
    assert notes == ["decode.adc: 1 words with wrong parity left out"]


def test_labels_in_the_order_of_sending():
    word = chapter10.bnr(0o210, 15, 2048.0, 250.0)
    turned = (word & ~0xFF) | int(
        f"{word & 0xFF:08b}"[::-1], 2
    )  # as many ones, so the parity stays
    stream = Words(np.zeros(1), words(turned))
    tables, _ = label_tables(stream, spec("transmitted", tas=TAS), "adc")
    assert tables["adc.tas"].columns["value"].tolist() == [250.0]
    with pytest.raises(
        UnknownName,
        match=r"unknown ARINC 429 label '210'.*turned round: try labels = \"transmitted\"",
    ):
        label_tables(stream, spec("octal", tas=TAS), "adc")


def test_words_in_a_column_of_any_other_file(tmp_path):
    rows = [(0.02 * i, chapter10.bnr(0o210, 15, 2048.0, 250.0 + i)) for i in range(5)]
    rows += [(0.02 * i, chapter10.bnr(0o325, 14, 180.0, -10.0 * i)) for i in range(5)]
    (tmp_path / "bus.csv").write_text(
        "time,word\n" + "".join(f"{t},{w}\n" for t, w in sorted(rows))
    )
    (tmp_path / "n.toml").write_text(
        """
        [decode.adc]
        kind = "arinc429"
        column = "word"
        labels = "octal"
        [decode.adc.parameters]
        tas = { label = "210", code = "bnr", bits = 15, range = 2048, unit = "kt" }
        roll = { label = "325", code = "bnr", bits = 14, range = 180, unit = "deg" }
        [air]
        V = "adc.tas"
        [attitude]
        phi = "adc.roll"
        """
    )
    record = flighttest.read(tmp_path / "bus.csv", tmp_path / "n.toml")
    np.testing.assert_allclose(record["air/V"].values, (250.0 + np.arange(5)) * 1852 / 3600)
    np.testing.assert_allclose(
        np.degrees(record["attitude/phi"].values), -10.0 * np.arange(5), atol=180 / 2**15
    )
