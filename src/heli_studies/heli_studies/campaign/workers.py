# SPDX-License-Identifier: Apache-2.0
"""Who flies a campaign's flights: this process, processes of this machine, or a Dask cluster.

Processes of this machine talk with the one that started them over pipes that nobody else can open.
"""

import contextlib
import logging
import multiprocessing
import os
import pickle
import tempfile
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol

from heli_core.errors import FlightError, StartError
from heli_core.rcl_yaml import ParameterError
from heli_flight import interrupts
from heli_flight.settings import sources_commit
from heli_studies.campaign.spec import FILES_IN

Rows = list[dict[str, Any]]


class FlightBatch(Protocol):
    """Flights with numbers from 0 on, which fly anywhere: a `Spec`, or what else has these four."""

    @property
    def chunk(self) -> int:
        """Flights of a task."""

    @property
    def count(self) -> int:
        """Flights of it."""

    def fly(self, numbers: Sequence[int]) -> Rows:
        """Fly these; a row each, with its number under `NUMBER`, that follows from it alone."""

    def killed(self, number: int) -> dict[str, Any]:
        """The row of a flight that ended its process each time; may raise FlightError."""


Fly = Callable[[Any, Sequence[Sequence[int]]], Iterator[Rows]]
"""From a `FlightBatch` and its tasks to rows, a task's at once, in any order."""


def tasks(batch: FlightBatch, done: set[int]) -> list[list[int]]:
    """What is still to be flown, by tasks; they are the same whoever flies them."""
    task_list, count = [], batch.count
    for first in range(0, count, batch.chunk):
        left = [n for n in range(first, min(first + batch.chunk, count)) if n not in done]
        if left:
            task_list.append(left)
    return task_list


@contextlib.contextmanager
def flier(workers: int, scheduler: str | None = None, resumes: bool = True) -> Iterator[Fly]:
    """Who flies: this process, processes of this machine, or another cluster.

    They stay for all calls, and end with this.

    Parameters
    ----------
    workers : int
        Processes of this machine, at most so many; 0: this one.
    scheduler : str or None
        Address of a Dask scheduler, such as tls://10.0.0.1:8786: its workers fly.
    resumes : bool
        Whether `--resume` goes on with what is flown.

    Raises
    ------
    ParameterError
        The scheduler cannot be reached, or a worker has other sources.
    FlightError
        While it flies: the scheduler has gone, or no process can be started.
    """
    if scheduler is not None:
        with _connected(scheduler) as client:
            yield partial(fly_on, client, resumes=resumes)
    elif workers == 0:
        yield fly_here
    else:
        with Processes(workers) as processes:
            yield processes.fly


def fly_here(batch: FlightBatch, todo: Sequence[Sequence[int]]) -> Iterator[Rows]:
    """Fly task after task in this process."""
    for numbers in todo:
        yield batch.fly(numbers)


# -------------------------------------------------------------------------------------------------
# Processes of this machine.
# -------------------------------------------------------------------------------------------------

# A fork would copy threads' locks as they happen to be; a fork server listens on a socket.
_SPAWN = multiprocessing.get_context("spawn")
_STARTS = 3
"""So many processes in turn that end before they are ready: the next ones would, too."""
_TRIES = 2
"""A flight that ends its process so often, alone in it, is given up."""


class Processes:
    """Processes of this machine, each with a task at a time; one that is killed is succeeded."""

    def __init__(self, count: int) -> None:
        # The matrices are small: threads of the linear algebra only cost time. It is inherited.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        self._count, self._workers = count, list[_Worker]()
        self._failed_starts = 0
        self._folder = tempfile.TemporaryDirectory(prefix="heli_campaign_")

    def __enter__(self) -> "Processes":
        return self

    def __exit__(self, *_: object) -> None:
        self._end(self._workers)
        self._folder.cleanup()

    def fly(self, batch: FlightBatch, todo: Sequence[Sequence[int]]) -> Iterator[Rows]:
        """Fly tasks; rows come as they are flown.

        Raises
        ------
        FlightError
            No process can be started, or a flight whose row cannot be told ends each.
        """
        waiting, ended = deque(map(list, todo)), Counter[int]()
        try:
            while waiting or any(worker.numbers for worker in self._workers):
                self._hand_out(batch, waiting)
                answering = wait([worker.end for worker in self._workers])
                for worker in [worker for worker in self._workers if worker.end in answering]:
                    try:
                        answer = worker.end.recv()
                    except (EOFError, OSError):
                        numbers = self._lost(worker)
                        ended.update(numbers if len(numbers) == 1 else ())
                        if len(numbers) == 1 and ended[numbers[0]] >= _TRIES:
                            yield [batch.killed(numbers[0])]
                        else:
                            # Alone, the one that does it takes no other along.
                            waiting.extendleft([number] for number in reversed(numbers))
                        continue
                    was_ready, worker.ready, worker.numbers = worker.ready, True, []
                    self._failed_starts = 0
                    if isinstance(answer, Exception):
                        raise answer
                    if was_ready:
                        yield answer
        finally:
            # Where this is broken off, nobody waits for what is under way.
            self._end([worker for worker in self._workers if worker.numbers])

    def _hand_out(self, batch: FlightBatch, waiting: deque[list[int]]) -> None:
        """Give each that waits for one a task, and start as many more as are of use."""
        for worker in [w for w in self._workers if w.ready and not w.numbers]:
            if waiting:
                worker.take(batch, waiting.popleft())
        starting = sum(not worker.ready for worker in self._workers)
        for _ in range(min(self._count - len(self._workers), len(waiting) - starting)):
            self._workers.append(_Worker(self._folder.name))

    def _lost(self, worker: "_Worker") -> list[int]:
        """Forget a process that has ended; the numbers that it was flying."""
        self._end([worker])
        self._failed_starts += not worker.ready
        if self._failed_starts >= _STARTS:
            raise StartError(
                f"processes that should fly end as they start (exit code {worker.process.exitcode})"
                "; a script that flies on workers does so below `if __name__ == '__main__':`"
            )
        return worker.numbers

    def _end(self, workers: "Sequence[_Worker]") -> None:
        for worker in workers:
            worker.process.kill()
        for worker in workers:
            worker.process.join()
            worker.end.close()
        self._workers = [worker for worker in self._workers if worker not in workers]


class _Worker:
    """A process with a pipe to it, which tells that it is ready, and then answers each task."""

    def __init__(self, folder: str) -> None:
        self.end, theirs = _SPAWN.Pipe()
        self.process = _SPAWN.Process(target=_work, args=(theirs, folder), daemon=True)
        self.ready, self.numbers, self._batch = False, list[int](), None
        # It inherits that SIGINT is blocked: Ctrl-C goes to all processes of a terminal, and this
        # one ends the others. The tracker unblocks it in the thread that starts it.
        resource_tracker.ensure_running()
        with interrupts.held_back():
            self.process.start()
        theirs.close()

    def take(self, batch: Any, numbers: list[int]) -> None:
        """Have it fly; a batch that it knows is not sent again."""
        self.numbers = numbers
        # What has ended meanwhile is noticed where its answer is awaited.
        with contextlib.suppress(OSError):
            self.end.send((None if batch is self._batch else batch, numbers))
        self._batch = batch


def _work(end: Connection, folder: str) -> None:
    """What a process does until the other end of its pipe is closed."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    os.environ[FILES_IN] = folder
    batch: Any = None
    end.send(None)
    with contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            message = end.recv_bytes()
            try:
                sent, numbers = pickle.loads(message)
                batch = batch if sent is None else sent
                answer: Rows | Exception = batch.fly(numbers)
            except Exception as error:
                answer = _sendable(error)
            end.send(answer)


def _sendable(error: Exception) -> Exception:
    """The error itself, if it can be sent at all."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return FlightError(f"{type(error).__name__}: {error}")
    return error


def _end_with_parent() -> None:
    """Nobody is left to take an answer: do not finish what is under way."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


# -------------------------------------------------------------------------------------------------
# A Dask cluster, which somebody else has started.
# -------------------------------------------------------------------------------------------------

_REACH_S = 20.0


@contextlib.contextmanager
def _connected(scheduler: str) -> Iterator[Any]:
    """A client of a cluster; to tls:// by the certificates that Dask's configuration names."""
    from distributed import Client, Security

    # What happens to the cluster is said in our own sentences.
    for name in [*logging.root.manager.loggerDict, "asyncio", "tornado"]:
        if name.partition(".")[0] in ("asyncio", "distributed", "tornado"):
            logging.getLogger(name).handlers = [logging.NullHandler()]
            logging.getLogger(name).propagate = False
    try:
        # Without it the client would not end for a minute.
        if scheduler.startswith("tls:") and not Security().get_connection_args("client").get(
            "ssl_context"
        ):
            raise ValueError("Dask's configuration names no certificates (distributed.comm.tls)")
        client = Client(scheduler, timeout=_REACH_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ParameterError(
            f"--scheduler {scheduler}: {' '.join(str(error).split())}; allowed: the address of "
            "a scheduler that runs, such as tls://127.0.0.1:8786"
        ) from None
    with client:
        for where, commit in client.run(sources_commit).items():
            _check_commit(commit, where)
        yield client


def fly_on(
    client: Any, batch: FlightBatch, todo: Sequence[Sequence[int]], resumes: bool = True
) -> Iterator[Rows]:
    """Fly tasks by a client of a cluster, as `flier` does; rows come as they are flown."""
    from distributed import CancelledError, as_completed
    from distributed.comm import CommClosedError

    # A key of its own: the same batch of an earlier call may be let go of at this very moment.
    shared = client.scatter(batch, broadcast=True, hash=False)
    futures = {client.submit(_fly, shared, list(n), pure=False): list(n) for n in todo}
    coming = as_completed(futures, loop=client.loop)
    try:
        for future in coming:
            numbers = futures.pop(future)
            rows, again = _taken(batch, future, numbers)
            for number in again:
                new = client.submit(_fly, shared, [number], pure=False)
                futures[new] = [number]
                coming.add(new)
            if rows:
                yield rows
    except (CancelledError, CommClosedError, TimeoutError, OSError):
        goes_on = ", --resume goes on" * resumes
        raise FlightError(f"the scheduler is gone; what was flown stays{goes_on}") from None


def _taken(batch: FlightBatch, future: Any, numbers: list[int]) -> tuple[Rows, list[int]]:
    """Rows of a task, or what to fly again, one by one, as its process has ended too often."""
    from distributed import KilledWorker

    try:
        commit, rows = future.result()
    except KilledWorker:
        return ([], numbers) if len(numbers) > 1 else ([batch.killed(numbers[0])], [])
    _check_commit(commit, future.key)
    return rows, []


def _fly(batch: FlightBatch, numbers: list[int]) -> tuple[str, Rows]:
    return sources_commit(), batch.fly(numbers)


def _check_commit(commit: str, where: str) -> None:
    if commit != sources_commit():
        raise ParameterError(
            f"--scheduler: {where}: a worker flies the sources of {commit}, these are "
            f"{sources_commit()}; allowed: the same on all"
        )
