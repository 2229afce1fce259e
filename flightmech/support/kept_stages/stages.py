"""Stages of a job: functions of their inputs, whose results are stored by the hash of the inputs.

A job calls its stages one after the other. A stage is not computed if the store has a result for
its inputs. The result of a stage is an input of the next stages by the hash of its stored bytes.
Therefore a change without an effect on the result does not lead to further computations.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from threading import Lock
from typing import Any, Generic, TypeVar

from flightmech.errors import AeromatchError, AeromatchWarning
from flightmech.support.kept_stages.captured_warnings import capture_warnings
from flightmech.support.kept_stages.content_hashes import content_hash
from flightmech.support.kept_stages.explanation import StageTrace
from flightmech.support.kept_stages.program import hash_arithmetic, hash_installation
from flightmech.support.kept_stages.sharing import Cores
from flightmech.support.kept_stages.store import StageStore

_Value = TypeVar("_Value")


class NotStored(AeromatchError):
    """A result of a stage that is not in the store, where nothing may be computed."""


class Kept(Generic[_Value]):
    """The result of a stage, in memory, or in the store until its first use.

    Parameters
    ----------
    digest : str
        Hash of the value, if known.
    made : tuple
        The value as a tuple of one, if it is in memory.
    make : callable
        Returns the tuple, if the value is not in memory.
    """

    def __init__(
        self,
        digest: str = "",
        made: tuple[_Value, ...] = (),
        make: Callable[[], tuple[_Value, ...]] | None = None,
    ) -> None:
        self._digest, self._made, self._make = digest, made, make
        self._lock = Lock()

    @property
    def value(self) -> _Value:
        """The value. It is read from the store on first use, or computed if the file is damaged."""
        # Threads of one stage may need the value for the first time at the same moment.
        with self._lock:
            if not self._made:
                assert self._make is not None
                self._made = self._make()
            return self._made[0]

    @property
    def content_digest(self) -> str:
        """Hash of the value, which represents it as an input."""
        if not self._digest:
            # a value that was not read from the store
            self._digest = content_hash(self.value)
        return self._digest

    def part(self, name: str, pick: Callable[[_Value], Any]) -> Kept[Any]:
        """Return a part of the result. Its hash is that of the result, so nothing is read."""
        digest = f"{self._digest} {name}" if self._digest else ""
        return Kept(digest, make=lambda: (pick(self.value),))


class Values(Mapping[str, Any]):
    """The values of results by name. Each value is read on first use."""

    def __init__(self, kept: Mapping[str, Kept[Any]]) -> None:
        self.kept = kept

    def __getitem__(self, name: str) -> Any:
        return self.kept[name].value

    def __iter__(self) -> Iterator[str]:
        return iter(self.kept)

    def __len__(self) -> int:
        return len(self.kept)


class Stages:
    """Computation and storage of the stages of a job.

    Parameters
    ----------
    store : StageStore, optional
        Without a store no results are stored.
    trace : StageTrace, optional
        Trace of the last job, for the reasons.
    fresh : bool
        Compute all stages, and replace their stored results.
    workers : Cores or Cluster, optional
        The default is the cores of this machine.
    explain : callable, optional
        Called with a line for each stage that is computed, with the reason.
    only_stored : bool
        Raise `NotStored` at the first stage that would have to be computed.

    Attributes
    ----------
    computed, reused : Counter
        Number of results by stage.
    remarks : list of str
        Texts of the warnings of all stages, also of stages with stored results.
    """

    def __init__(
        self,
        store: StageStore | None = None,
        trace: StageTrace | None = None,
        fresh: bool = False,
        workers: Any = None,
        explain: Callable[[str], None] | None = None,
        only_stored: bool = False,
    ) -> None:
        self._only_stored = only_stored
        self.store, self.fresh, self.workers = store, fresh, workers or Cores()
        self.computed: Counter[str] = Counter()
        self.reused: Counter[str] = Counter()
        self.remarks: list[str] = []
        self._trace, self._explain = trace, explain
        # results of this job by key
        self._results: dict[str, Kept[Any]] = {}

    def one(
        self, stage: str, inputs: Mapping[str, Any], make: Callable[[], _Value], item: str = ""
    ) -> Kept[_Value]:
        """Return the result of `make`, from the store if possible.

        Parameters
        ----------
        stage : str
            Name of the stage.
        inputs : mapping of str to object
            All inputs of the result besides the program: `Kept`, `FileContent`, or an argument of
            `content_hash`.
        make : callable
            Computes the result.
        item : str
            Name of the result, if the stage has several results.
        """
        key, result = self._find(stage, item, inputs, lambda: capture_warnings(make))
        if result is not None:
            return result
        return self._store_result(stage, key, capture_warnings(make))

    def each(
        self,
        stage: str,
        inputs: Mapping[str, Mapping[str, Any]],
        function: Callable[..., _Value],
        arguments: Callable[[str], tuple[Any, ...]],
        jobs: int = 1,
        threads: bool = False,
    ) -> dict[str, Kept[_Value]]:
        """Return the results of a function for all items.

        Results that are not in the store are computed in parallel, and stored when they are
        complete.

        Parameters
        ----------
        stage : str
            Name of the stage.
        inputs : mapping of str to mapping
            Inputs of each item, as in `one`.
        function : callable
            A function of a module, so that another process can import it.
        arguments : callable
            Returns the arguments for an item. It is called only for items that are computed.
        jobs, threads
            As in `Cores.unordered`.
        """

        # for an item whose file turns out to be damaged when it is read
        def recompute(item: str) -> tuple[_Value, list[str]]:
            return capture_warnings(function, *arguments(item))

        keys, results = self._find_items(stage, inputs, recompute)
        missing = [item for item in inputs if item not in results]
        if missing:
            calls = ((function, *arguments(item)) for item in missing)
            if jobs > 0:
                jobs = min(jobs, len(missing))
            for i, result in self.workers.unordered(capture_warnings, calls, jobs, threads):
                item = missing[i]
                results[item] = self._store_result(stage, keys[item], result)
        return {item: results[item] for item in inputs}

    def batch(
        self,
        stage: str,
        inputs: Mapping[str, Mapping[str, Any]],
        compute: Callable[[list[str], Callable[..., None]], None],
    ) -> dict[str, Kept[Any]]:
        """Return the results of a function that computes several items in one call.

        Parameters
        ----------
        stage, inputs
            As in `each`.
        compute : callable
            Called once with the items that are not in the store, and with a function
            ``put(item, value, keep=True)``. It calls `put` for each item when its value is
            complete. With ``keep=False`` the value is not stored.
        """

        def put(item: str, value: Any, keep: bool = True) -> None:
            if keep:
                results[item] = self._store_result(stage, keys[item], (value, []))
            else:
                results[item] = self.given(value)

        def recompute(item: str) -> tuple[Any, list[str]]:
            values: list[Any] = []
            compute([item], lambda _, value, keep=True: values.append(value))
            return values[0], []

        keys, results = self._find_items(stage, inputs, recompute)
        missing = [item for item in inputs if item not in results]
        if missing:
            compute(missing, put)
        return {item: results[item] for item in inputs}

    def given(self, value: _Value) -> Kept[_Value]:
        """Return a value in memory as an input of a stage."""
        return Kept(made=(value,))

    @property
    def local(self) -> bool:
        """Whether the cores of this machine compute the stages, so that threads share memory."""
        return isinstance(self.workers, Cores)

    def recall(self, stage: str, inputs: Mapping[str, Any], nothing: _Value) -> _Value:
        """Return the value that `remember` stored for these inputs, else `nothing`.

        Such a value only saves time, and can grow from job to job. The results of stages must not
        depend on it.
        """
        if self.store is None or self.fresh:
            return nothing
        entry = self.store.read(stage, self._make_key(stage, inputs)[0])
        return entry[0] if entry else nothing

    def remember(self, stage: str, inputs: Mapping[str, Any], value: Any) -> None:
        """Store a value for `recall`, which replaces an earlier value."""
        if self.store is not None:
            self.store.write(stage, self._make_key(stage, inputs)[0], value)

    def close(self) -> None:
        """Store the inputs of this job for the reasons of the next one. Call it after the job."""
        if self._trace is not None:
            self._trace.close()

    def _find_items(
        self,
        stage: str,
        inputs: Mapping[str, Mapping[str, Any]],
        recompute: Callable[[str], tuple[Any, list[str]]],
    ) -> tuple[dict[str, str], dict[str, Kept[Any]]]:
        """Return the keys of all items, and the results of the items that need no computation."""
        keys: dict[str, str] = {}
        results: dict[str, Kept[Any]] = {}
        for item, item_inputs in inputs.items():
            keys[item], result = self._find(stage, item, item_inputs, partial(recompute, item))
            if result is not None:
                results[item] = result
        return keys, results

    def _find(
        self,
        stage: str,
        item: str,
        inputs: Mapping[str, Any],
        make: Callable[[], tuple[Any, list[str]]],
    ) -> tuple[str, Kept[Any] | None]:
        """Return the key of a result, and the result, or None if it must be computed.

        `make` computes the result again if its file is damaged.
        """
        if self.store is None:
            self._demand_stored(stage, item)
            self.computed[stage] += 1
            return "", None
        key, hashes = self._make_key(stage, inputs)
        name = f"{stage} {item}".rstrip()
        # an earlier stage of this job had the same inputs, and was counted
        if key in self._results:
            return key, self._results[key]
        head = None if self.fresh else self.store.head(stage, key)
        if head is None:
            self._demand_stored(stage, item)
            self.computed[stage] += 1
            self._explain_run(name, hashes)
        else:
            self.reused[stage] += 1
            self._add_remarks(head[1])
            self._results[key] = self._read_later(stage, key, head[0], make)
        if self._trace is not None:
            self._trace.note(name, hashes)
        return key, self._results.get(key)

    def _demand_stored(self, stage: str, item: str) -> None:
        if self._only_stored:
            raise NotStored(
                f"{stage} {item}".rstrip() + " is not in the store; run the match, which computes "
                "and stores it"
            )

    def _explain_run(self, name: str, hashes: Mapping[str, str]) -> None:
        if self._explain is None:
            return
        reason = "not kept"
        if self.fresh:
            reason = "--fresh"
        elif self._trace is not None:
            reason = self._trace.reason(name, hashes)
        self._explain(f"{name}: {reason}")

    @staticmethod
    def _make_key(stage: str, inputs: Mapping[str, Any]) -> tuple[str, dict[str, str]]:
        """Return the key of a result, and the hashes of its inputs."""
        hashes = {"program": content_hash(hash_installation(), hash_arithmetic())}
        for name, value in inputs.items():
            hashes[name] = content_hash(value)
        return content_hash(stage, hashes), hashes

    def _read_later(
        self, stage: str, key: str, digest: str, make: Callable[[], tuple[Any, list[str]]]
    ) -> Kept[Any]:
        """Return a result that is read from the store on first use."""
        assert self.store is not None
        store = self.store

        def read() -> tuple[Any, ...]:
            if entry := store.read(stage, key):
                return entry
            # the file is damaged, or another job cleared the store
            self.computed[stage] += 1
            if self._explain is not None:
                self._explain(f"{stage}: what was kept is damaged")
            value, remarks = make()
            store.write(stage, key, value, remarks)
            return (value,)

        return Kept(digest, make=read)

    def _store_result(self, stage: str, key: str, result: tuple[Any, list[str]]) -> Kept[Any]:
        value, remarks = result
        self._add_remarks(remarks)
        if self.store is None:
            return Kept(made=(value,))
        digest = self.store.write(stage, key, value, remarks)
        self._results[key] = Kept(digest, (value,))
        return self._results[key]

    def _add_remarks(self, texts: Sequence[str]) -> None:
        # also for a stored result, so that each run shows the same warnings
        self.remarks += texts
        for text in texts:
            warnings.warn(text, AeromatchWarning, stacklevel=4)
