"""Public names of `datcom_io.exchange`."""

from .datcom_plus import read_datcom_plus_csv as read_datcom_plus_csv
from .matlab_read import read_matlab as read_matlab
from .matlab_write import write_matlab as write_matlab
from .refining import refine as refine
from .unit13 import read_plot as read_plot
from .unit14 import read_for014 as read_for014
