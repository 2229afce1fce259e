"""Names of files that every system allows."""

from __future__ import annotations

import re

# Letters that are not a part of a name on some system: separators, drives, patterns, quotes.
_ODD_LETTERS = re.compile(r'[\x00-\x1f\x7f/\\:*?"<>|]')
# Names of devices on Windows, with any ending.
_DEVICES = re.compile(r"(?:CON|PRN|AUX|NUL|COM\d|LPT\d) *(?:\..*)?", re.IGNORECASE)


def is_portable_name(name: str) -> bool:
    """Return whether Linux, macOS and Windows allow a name of a file or folder, without a path.

    Windows opens a device for ``NUL.csv``, and a stream or a drive for a name with a colon.

    Examples
    --------
    >>> is_portable_name("nul.csv"), is_portable_name("null.csv")
    (False, True)
    """
    return bool(name) and not _ODD_LETTERS.search(name) and not _DEVICES.fullmatch(name)
