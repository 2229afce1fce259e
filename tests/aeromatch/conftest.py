import sys
from types import SimpleNamespace

import pytest

from aeromatch.cli.command import main


@pytest.fixture
def aeromatch(monkeypatch, capfd):
    """The command as a user calls it, in this process: arguments in; exit code, stdout and stderr
    out.
    """

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["aeromatch", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        output = capfd.readouterr()
        return SimpleNamespace(returncode=ended.value.code, stdout=output.out, stderr=output.err)

    return call
