"""Public names of `flighttest.in_flight`."""

from .following import AccuracyGoal as AccuracyGoal
from .following import FlightEstimate as FlightEstimate
from .following import FlightFollower as FlightFollower
from .sample_stream import SampleStream as SampleStream
