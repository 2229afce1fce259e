"""Command line of aeromatch: the command ``aeromatch``, its verbs, and the options of data packages
and the workbench.
"""

from aeromatch.cli.command import cli as cli
from aeromatch.cli.command import main as main
