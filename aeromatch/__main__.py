"""``python -m aeromatch`` is the command ``aeromatch``."""

from .cli import main

main()
