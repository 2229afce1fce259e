"""Distribution of the tests over the processes of pytest-xdist."""

from xdist.scheduler import LoadScopeScheduling


class FileScheduling(LoadScopeScheduling):
    """Give all tests of a file to one process, and each page of the documentation to any.

    A fixture of a file is then made once, not once in each process. The marks ``xdist_group`` and
    ``--dist loadgroup`` of pytest-xdist 3.8 do not do it under pytest 9.2: it adds the group to the
    identifier of the test, which that pytest no longer permits and silently ignores.
    """

    def _split_scope(self, nodeid: str) -> str:
        """Return the group of a test, from its identifier."""
        file = nodeid.partition("::")[0]
        if file == "tests/test_docs.py":
            return nodeid
        return file
