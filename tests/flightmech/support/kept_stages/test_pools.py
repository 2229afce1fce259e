"""Pools of processes on the cores of this machine."""

import os

import pytest
from joblib import delayed

from flightmech.support.kept_stages.sharing import process_pool


@pytest.mark.slow
def test_a_kept_process_follows_the_folder_of_the_program(tmp_path, monkeypatch):
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        (folder, *others) = process_pool(2)(delayed(os.getcwd)() for _ in range(4))
        assert {folder, *others} == {os.getcwd()}
