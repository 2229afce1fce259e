"""The reply of the reader of MATLAB files, which is not trusted."""

import io
import os
import pickle

import numpy as np
import pytest

from flightmech.support.array_files.mat_files import _ArrayUnpickler


class Command:
    """An object whose unpickling runs a command."""

    def __init__(self, words):
        self.words = words

    def __reduce__(self):
        return os.system, (self.words,)


def test_arrays_and_plain_values_are_read():
    fields = np.zeros(2, [("x", "O"), ("y", float)])
    content = {"a": np.arange(6.0).reshape(2, 3), "b": fields, "c": "text", "d": np.float64(1.5)}
    kind, got = _ArrayUnpickler(io.BytesIO(pickle.dumps(("", content), protocol=5))).load()
    assert (kind, got["c"], got["d"]) == ("", "text", 1.5)
    np.testing.assert_array_equal(got["a"], content["a"])
    assert got["b"].dtype == fields.dtype


def test_a_reply_runs_nothing(tmp_path):
    reply = pickle.dumps(("", {"a": Command(f"touch {tmp_path}/x")}))
    with pytest.raises(pickle.UnpicklingError, match="is not an array"):
        _ArrayUnpickler(io.BytesIO(reply)).load()
    assert list(tmp_path.iterdir()) == []
