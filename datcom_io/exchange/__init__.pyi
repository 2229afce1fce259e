"""Public names of `datcom_io.exchange` and where they are defined; ``__init__.py`` loads them from this list."""

from .datcom_plus import read_datcom_plus_csv as read_datcom_plus_csv
from .matlab.read import read_matlab as read_matlab
from .matlab.write import write_matlab as write_matlab
from .plot_files.refining import refine as refine
from .plot_files.unit13 import read_plot as read_plot
from .plot_files.unit14 import read_for014 as read_for014
