"""Files that are written whole or not at all."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex


@contextmanager
def written_whole(path: str | os.PathLike) -> Iterator[Path]:
    """Yield a place beside `path` to write to; it takes the name of `path` once the block has ended well.

    Parameters
    ----------
    path : path
        The file; an older one stays as it was until the new one is complete on disk.

    Raises
    ------
    FileNotFoundError
        Its folder is not there.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "no such folder; make it first", str(path.parent))
    part = path.with_name(f".{path.name}.{token_hex(4)}.part")
    try:
        yield part
        with part.open("r+b") as written:
            os.fsync(written.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
