"""``python -m aeromatch`` is the command ``aeromatch``."""

from __future__ import annotations

from aeromatch.cli.command import main

main()
