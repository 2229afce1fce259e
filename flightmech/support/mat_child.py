"""The child process of `load_mat`: a MAT file on standard input, options as JSON in the command, a
pickle on standard output.

The pickle is a pair: an empty text and the content, or the type and the text of the error.
"""

from __future__ import annotations

import io
import json
import pickle
import sys
from typing import Any


def decode_mat(raw: bytes, options: dict[str, Any]) -> tuple[str, Any]:
    """Return the pair."""
    from scipy.io import loadmat

    stream: Any = io.BytesIO(raw)
    try:
        return "", loadmat(stream, **options)
    except Exception as error:  # SciPy lets through whatever damaged bytes do to it
        return type(error).__name__, " ".join(str(error).split())[:300]


def decode_standard_input() -> None:
    """Decode standard input."""
    stream = sys.stdout.buffer
    sys.stdout = sys.stderr
    stream.write(
        pickle.dumps(decode_mat(sys.stdin.buffer.read(), json.loads(sys.argv[1])), protocol=5)
    )
    stream.flush()


if __name__ == "__main__":
    decode_standard_input()
