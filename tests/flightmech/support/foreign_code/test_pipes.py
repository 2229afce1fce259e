"""Bytes for a foreign process arrive whole, also where the pipe takes a part of them."""

import pickle

import numpy as np

from flightmech.support.foreign_code.process import write_whole


class ShortPipe:
    """An unbuffered pipe whose writes are cut short, as by a signal that stops the process."""

    def __init__(self):
        self.content = b""

    def write(self, part):
        self.content += bytes(part[:1000])
        return min(len(part), 1000)


def test_a_job_arrives_whole_through_short_writes():
    job = {"time": np.arange(5000.0), "number": 3}
    pipe = ShortPipe()
    write_whole(pipe, pickle.dumps(job))
    arrived = pickle.loads(pipe.content)
    assert arrived["number"] == 3
    assert np.array_equal(arrived["time"], job["time"])
