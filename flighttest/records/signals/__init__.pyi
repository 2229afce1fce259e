"""Public names of `flighttest.records.signals`."""

from .conditioning import channel as channel
from .conditioning import cut as cut
from .conditioning import smooth as smooth
from .delays import Delay as Delay
from .delays import follow_command as follow_command
from .delays import remove_lag as remove_lag
from .delays import time_delay as time_delay
from .differentiation import Smoothed as Smoothed
from .differentiation import derivative as derivative
from .differentiation import derivative_window as derivative_window
from .differentiation import fourier_smooth as fourier_smooth
from .fourier import finite_fourier as finite_fourier
from .fourier import harmonics as harmonics
from .record_flags import add_flags as add_flags
from .record_flags import flags as flags
from .resampling import lowpass as lowpass
from .resampling import remove_delay as remove_delay
from .resampling import resample as resample
