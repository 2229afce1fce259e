"""Topics of a PX4 log with a limit on the fields that its formats require.

A format of ULog may contain arrays and other formats. Sixty formats of a hundred elements, each
in the one before it, are 3 kB of a file and 1e120 fields, which pyulog lists one by one.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pyulog import ULog

from flightmech.errors import ParseError

MOST_FIELDS = 200_000
"""Fields of all topics of a log; those of a long flight have some ten thousand."""


class BoundedLog(ULog):
    """A PX4 log; a ParseError ends the reading when its formats require too many fields."""

    def __init__(self, file: str, topics: list[str] | None) -> None:
        fields = 0

        class Topic(ULog._MessageAddLogged):
            def _parse_nested_type(
                self, prefix: str, name: str, formats: Mapping[str, Any]
            ) -> None:
                nonlocal fields
                # an array is counted before it is listed, and a format without fields as one
                sizes = [max(size, 1) for _, size, _ in formats[name].fields]
                fields += sum(sizes) + 1
                if fields > MOST_FIELDS:
                    raise ParseError(
                        file,
                        0,
                        f"formats of more than {MOST_FIELDS} fields",
                        "the formats of a PX4 log; the file is damaged",
                    )
                super()._parse_nested_type(prefix, name, formats)

        # pyulog makes its topics from this class
        self._MessageAddLogged = Topic
        super().__init__(file, topics)
