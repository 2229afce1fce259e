"""Public names of `datcom_io.runs`."""

from .running import ProgramRun as ProgramRun
from .running import ProgramRun as Run
from .running import run_deck as run_deck
from .running import run_folder as run_folder
from .splitting import split_deck as split_deck
