"""Public names of `aerodb.figures`."""

from .comparison_figures import plot_difference as plot_difference
from .drawing import save_figure as save_figure
from .figure_folder import write_comparison as write_comparison
from .figures import plot_comparison as plot_comparison
from .figures import plot_term as plot_term
from .lr743_set.envelope import one_g_lines as one_g_lines
from .lr743_set.flown import FlightData as FlightData
from .lr743_set.flown import FlightData as Flown
from .lr743_set.flown import partial_residuals as partial_residuals
from .lr743_set.flown import read_flown as read_flown
from .lr743_set.report_set import write_lr743 as write_lr743
