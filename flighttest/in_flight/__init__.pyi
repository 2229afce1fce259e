"""Public names of `flighttest.in_flight`."""

from .following import FlightFollower as FlightFollower
from .following import Goal as Goal
from .following import RunningEstimate as RunningEstimate
from .sample_stream import SampleStream as SampleStream
