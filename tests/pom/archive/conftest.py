"""The command line, called in this process."""

import sys
from types import SimpleNamespace

import pytest

from aeromatch.cli.command import main


@pytest.fixture
def aeromatch(monkeypatch, capsys):
    def call(*words):
        monkeypatch.setattr(sys, "argv", ["aeromatch", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        output = capsys.readouterr()
        return SimpleNamespace(returncode=ended.value.code, stdout=output.out, stderr=output.err)

    return call
