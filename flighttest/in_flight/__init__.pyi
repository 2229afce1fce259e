"""Public names of `flighttest.in_flight`."""

from .flight_estimate import AccuracyGoal as AccuracyGoal
from .flight_estimate import FlightEstimate as FlightEstimate
from .following import FlightFollower as FlightFollower
from .sample_stream import SampleStream as SampleStream
