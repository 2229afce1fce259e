"""Stages of a job: each is a function of its inputs, whose hashes name what is kept of it.

There is no graph and no engine: a job calls its stages one after the other, and a stage that is
kept under its inputs is not computed. What a stage gives counts as an input of the next by the hash
of what is kept, so that a change without effect ends there.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Generic, TypeVar

from flightmech.errors import AeromatchWarning
from flightmech.support.kept_stages.content_hashes import content_hash
from flightmech.support.kept_stages.explanation import StageTrace
from flightmech.support.kept_stages.program import hash_arithmetic, hash_installation
from flightmech.support.kept_stages.sharing import Cores
from flightmech.support.kept_stages.store import StageStore

_Value = TypeVar("_Value")


class Kept(Generic[_Value]):
    """The result of a stage: at hand, or in the store until somebody needs it.

    Parameters
    ----------
    digest : str
        Of what it holds, where that is known.
    made : tuple
        The value, where it is at hand.
    make : callable
        Gives that tuple elsewhere.
    """

    def __init__(
        self,
        digest: str = "",
        made: tuple[_Value, ...] = (),
        make: Callable[[], tuple[_Value, ...]] | None = None,
    ) -> None:
        self._digest, self._made, self._make = digest, made, make

    @property
    def value(self) -> _Value:
        """What it holds: read from the store when it is first needed, computed again where the file
        turns out to be damaged.
        """
        if not self._made:
            assert self._make is not None
            self._made = self._make()
        return self._made[0]

    @property
    def content_digest(self) -> str:
        """Hash of what it holds, by which it counts as an input."""
        if not self._digest:
            self._digest = content_hash(self.value)
        return self._digest

    def part(self, name: str, pick: Callable[[_Value], Any]) -> Kept[Any]:
        """Return a part of the result, which counts by the whole; nothing is read for it."""
        return Kept(
            f"{self._digest} {name}" if self._digest else "", make=lambda: (pick(self.value),)
        )


class Values(Mapping[str, Any]):
    """The values of results by name, each read when it is first needed."""

    def __init__(self, kept: Mapping[str, Kept[Any]]) -> None:
        self.kept = kept

    def __getitem__(self, name: str) -> Any:
        return self.kept[name].value

    def __iter__(self) -> Iterator[str]:
        return iter(self.kept)

    def __len__(self) -> int:
        return len(self.kept)


class Stages:
    """Where the stages of a job are computed and kept.

    Parameters
    ----------
    store : StageStore, optional
        None: nothing is kept.
    trace : StageTrace, optional
        Of the last job, for the reasons.
    fresh : bool
        Compute everything, whatever is kept, and keep it anew.
    workers : Cores or Cluster, optional
        The cores of this machine unless given.
    explain : callable, optional
        Called with a line for every stage that is computed, which states why.

    Attributes
    ----------
    computed, reused : Counter
        Number of results by stage.
    remarks : list of str
        Texts of the warnings that stages gave, now or when they were computed.
    """

    def __init__(
        self,
        store: StageStore | None = None,
        trace: StageTrace | None = None,
        fresh: bool = False,
        workers: Any = None,
        explain: Callable[[str], None] | None = None,
    ) -> None:
        self.store, self.fresh, self.workers = store, fresh, workers or Cores()
        self.computed: Counter[str] = Counter()
        self.reused: Counter[str] = Counter()
        self.remarks: list[str] = []
        self._trace, self._explain = trace, explain
        self._done: dict[str, Kept[Any]] = {}  # by key

    def one(
        self, stage: str, inputs: Mapping[str, Any], make: Callable[[], _Value], item: str = ""
    ) -> Kept[_Value]:
        """Return what `make` gives, or what is kept of it.

        Parameters
        ----------
        stage : str
        inputs : mapping of str to object
            All that the result depends on besides the program: `Kept`, `FileContent`, or what
            `content_hash` takes.
        make : callable
        item : str
            Of several results of the stage.
        """
        key, kept = self._known(stage, item, inputs, lambda: capture_warnings(make))
        return kept if kept is not None else self._keep(stage, key, capture_warnings(make))

    def each(
        self,
        stage: str,
        inputs: Mapping[str, Mapping[str, Any]],
        function: Callable[..., _Value],
        arguments: Callable[[str], tuple[Any, ...]],
        jobs: int = 1,
        threads: bool = False,
    ) -> dict[str, Kept[_Value]]:
        """Return what a function gives for every item; what is not kept is shared out to cores or
        workers, and kept as it comes.

        Parameters
        ----------
        stage : str
        inputs : mapping of str to mapping
            Those of `one`, by item.
        function : callable
            Of a module, so that it can go to another process.
        arguments : callable
            Gives the arguments for an item; called only for what has to be computed.
        jobs, threads
            As `Cores.unordered`.
        """

        def again(item: str) -> Callable[[], tuple[_Value, list[str]]]:
            return lambda: capture_warnings(function, *arguments(item))

        known = {
            item: self._known(stage, item, given, again(item)) for item, given in inputs.items()
        }
        found = {item: kept for item, (_, kept) in known.items() if kept is not None}
        missing = [item for item in inputs if item not in found]
        # threads share what catches warnings: theirs are shown as they come
        work = _without_record if threads else capture_warnings
        calls = ((function, *arguments(item)) for item in missing)
        shared = (
            self.workers.unordered(
                work, calls, min(jobs, len(missing)) if jobs > 0 else jobs, threads
            )
            if missing
            else ()
        )
        for place, result in shared:
            item = missing[place]
            found[item] = self._keep(stage, known[item][0], result)
        return {item: found[item] for item in inputs}

    def batch(
        self,
        stage: str,
        inputs: Mapping[str, Mapping[str, Any]],
        compute: Callable[[list[str], Callable[..., None]], None],
    ) -> dict[str, Kept[Any]]:
        """Return the results of a call that makes several of them, as far as they are not kept.

        Parameters
        ----------
        stage, inputs
            As `each`.
        compute : callable
            Called with the items to compute, unless there are none, and with ``put(item, value,
            keep=True)``, which it calls for each of them as soon as it is there.
        """
        found: dict[str, Kept[Any]] = {}

        def put(item: str, value: Any, keep: bool = True) -> None:
            found[item] = (
                self._keep(stage, known[item][0], (value, [])) if keep else self.given(value)
            )

        def again(item: str) -> Callable[[], tuple[Any, list[str]]]:
            def make() -> tuple[Any, list[str]]:
                made: list[Any] = []
                compute([item], lambda _, value, keep=True: made.append(value))
                return made[0], []

            return make

        known = {
            item: self._known(stage, item, given, again(item)) for item, given in inputs.items()
        }
        found |= {item: kept for item, (_, kept) in known.items() if kept is not None}
        missing = [item for item in inputs if item not in found]
        if missing:
            compute(missing, put)
        return {item: found[item] for item in inputs}

    def given(self, value: _Value) -> Kept[_Value]:
        """Return a value that is at hand as an input of a stage."""
        return Kept(made=(value,))

    @property
    def local(self) -> bool:
        """Whether the cores of this machine do the work, so that threads share what is at hand."""
        return isinstance(self.workers, Cores)

    def recall(self, stage: str, inputs: Mapping[str, Any], nothing: _Value) -> _Value:
        """Return what `remember` kept under these inputs, else `nothing`.

        It may have become more with every job, and saves work only: the results of stages do not
        depend on how much there is.
        """
        if self.store is None or self.fresh:
            return nothing
        found = self.store.read(stage, self._key(stage, inputs)[0])
        return found[0] if found else nothing

    def remember(self, stage: str, inputs: Mapping[str, Any], value: Any) -> None:
        """Keep a value for `recall`, in the place of an earlier one."""
        if self.store is not None:
            self.store.write(stage, self._key(stage, inputs)[0], value)

    def close(self) -> None:
        """Keep what the next job is compared with; called when the job is done."""
        if self._trace is not None:
            self._trace.close()

    def _known(
        self,
        stage: str,
        item: str,
        inputs: Mapping[str, Any],
        make: Callable[[], tuple[Any, list[str]]],
    ) -> tuple[str, Kept[Any] | None]:
        """Return the key of a result, and the result; None when it has to be computed. `make`
        computes what turns out to be damaged.
        """
        if self.store is None:
            self.computed[stage] += 1
            return "", None
        (key, hashes), name = self._key(stage, inputs), f"{stage} {item}".rstrip()
        if key in self._done:  # this job had it before, and counted it
            return key, self._done[key]
        head = None if self.fresh else self.store.head(stage, key)
        if head is not None:
            self.reused[stage] += 1
            self._remark(head[1])
        else:
            self.computed[stage] += 1
            if self._explain is not None:
                why = (
                    "--fresh"
                    if self.fresh
                    else self._trace.reason(name, hashes)
                    if self._trace is not None
                    else "not kept"
                )
                self._explain(f"{name}: {why}")
        if self._trace is not None:
            self._trace.note(name, hashes)
        if head is not None:
            self._done[key] = self._lazily(stage, key, head[0], make)
        return key, self._done.get(key)

    @staticmethod
    def _key(stage: str, inputs: Mapping[str, Any]) -> tuple[str, dict[str, str]]:
        """Return the key of a result, and the hashes it is made of."""
        hashes = {
            "program": content_hash(hash_installation(), hash_arithmetic()),
            **{name: content_hash(one) for name, one in inputs.items()},
        }
        return content_hash(stage, hashes), hashes

    def _lazily(
        self, stage: str, key: str, digest: str, make: Callable[[], tuple[Any, list[str]]]
    ) -> Kept[Any]:
        assert self.store is not None
        store = self.store

        def read() -> tuple[Any, ...]:
            if entry := store.read(stage, key):
                return entry
            self.computed[stage] += 1  # it is damaged, or another job cleared it
            if self._explain is not None:
                self._explain(f"{stage}: what was kept is damaged")
            value, remarks = make()
            store.write(stage, key, value, remarks)
            return (value,)

        return Kept(digest, make=read)

    def _keep(self, stage: str, key: str, result: tuple[Any, list[str]]) -> Kept[Any]:
        value, remarks = result
        self._remark(remarks)
        if self.store is None:
            return Kept(made=(value,))
        self._done[key] = Kept(self.store.write(stage, key, value, remarks), (value,))
        return self._done[key]

    def _remark(self, texts: Sequence[str]) -> None:
        self.remarks += texts
        for text in texts:
            warnings.warn(text, AeromatchWarning, stacklevel=4)


def capture_warnings(function: Callable[..., _Value], *arguments: Any) -> tuple[_Value, list[str]]:
    """Return the result of a call, and the texts of the warnings of this package; others are given
    on as they are.
    """
    caught: list[warnings.WarningMessage] = []
    own: list[str] = []
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", AeromatchWarning)
            value = function(*arguments)
        own = list(
            dict.fromkeys(
                str(one.message) for one in caught if issubclass(one.category, AeromatchWarning)
            )
        )
    finally:
        for one in caught:
            if str(one.message) not in own:
                warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
    return value, own


def _without_record(function: Callable[..., _Value], *arguments: Any) -> tuple[_Value, list[str]]:
    return function(*arguments), []
