"""Delays and lags of channels and instruments that no instrument has."""

import pydantic
import pytest

from flighttest.records.readers.name_map import Channel
from flighttest.records.sensors.instruments import Instrument


def test_a_delay_in_milliseconds_is_refused_at_the_name_map():
    assert Channel(column="GS North", delay="150 ms").delay == pytest.approx(0.15)
    with pytest.raises(pydantic.ValidationError) as failure:
        Channel(column="GS North", delay=150)
    text = str(failure.value)
    assert "delay is 150 s; allowed are at most 5 s" in text
    assert 'write "150 ms" if that is meant' in text


def test_a_lag_in_milliseconds_is_refused_at_the_name_map():
    with pytest.raises(pydantic.ValidationError, match="lag is -80 s; allowed are at most 60 s"):
        Channel(column="servo", lag=-80)


def test_a_delay_in_milliseconds_is_refused_at_the_instrument():
    assert Instrument(delay=["150 ms", "50 ms"]).delay == pytest.approx((0.15, 0.05))
    with pytest.raises(pydantic.ValidationError, match="the mean of delay is 150 s; allowed"):
        Instrument(delay=[150, 50])
    with pytest.raises(pydantic.ValidationError, match="the sigma of delay is 50 s; allowed"):
        Instrument(delay=[0.15, 50])
