"""Public names of `flighttest.signals` and where they are defined; ``__init__.py`` loads them from this list."""

from .conditioning import channel as channel
from .conditioning import cut as cut
from .conditioning import lowpass as lowpass
from .conditioning import remove_delay as remove_delay
from .conditioning import resample as resample
from .conditioning import smooth as smooth
from .delays import Delay as Delay
from .delays import time_delay as time_delay
from .differentiation import derivative as derivative
from .differentiation import derivative_window as derivative_window
from .first_order_lag import follow_command as follow_command
from .first_order_lag import remove_lag as remove_lag
from .fourier import finite_fourier as finite_fourier
from .fourier import harmonics as harmonics
from .fourier_smoothing import Smoothed as Smoothed
from .fourier_smoothing import fourier_smooth as fourier_smooth
from .sample_flags import add_flags as add_flags
from .sample_flags import flags as flags
