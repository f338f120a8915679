# SPDX-License-Identifier: Apache-2.0
"""A campaign's flights on many processes: here, or where a Dask scheduler has its workers."""

import contextlib
import logging
import os
from collections.abc import Iterator, Sequence
from multiprocessing import resource_tracker
from typing import Any

from heli_flight import interrupts
from heli_flight.errors import FlightError
from heli_flight.loop.commit import sources_commit
from heli_flight.studies.dispersion.row import fly_rows, killed
from heli_flight.studies.dispersion.spec import Spec
from heli_parameters.parameters import ParameterError

Rows = list[dict[str, Any]]
_REACH_S = 20.0
# Dask looks at each worker's stack every 10 ms: one that compiles kernels nearly comes to a halt.
_UNPROFILED = {"distributed.worker.profile.enabled": False}
_SILENT = logging.CRITICAL + 1
_GONE = "the scheduler is gone; what was flown stays, --resume goes on"


def tasks(spec: Spec, done: set[int]) -> list[list[int]]:
    """What is still to be flown, by tasks; they are the same whoever flies them."""
    found = []
    for first in range(0, len(spec.inputs), spec.chunk):
        left = [n for n in range(first, min(first + spec.chunk, len(spec.inputs))) if n not in done]
        if left:
            found.append(left)
    return found


def fly_here(spec: Spec, todo: Sequence[Sequence[int]]) -> Iterator[Rows]:
    """Fly task after task in this process."""
    for numbers in todo:
        yield fly_rows(spec, numbers)


def fly_by_dask(
    spec: Spec, todo: Sequence[Sequence[int]], workers: int, scheduler: str | None
) -> Iterator[Rows]:
    """Fly tasks on a cluster; rows come as they are flown.

    Parameters
    ----------
    spec : Spec
    todo : sequence of sequence of int
        As of `tasks`.
    workers : int
        Processes of a cluster on this machine.
    scheduler : str or None
        Address of another cluster's, such as tcp://10.0.0.1:8786.

    Raises
    ------
    ParameterError
        The scheduler cannot be reached, or a worker has other sources.
    FlightError
        The scheduler has gone.
    """
    with connected(workers, scheduler) as client:
        yield from fly_on(client, spec, todo)


def fly_on(client: Any, spec: Spec, todo: Sequence[Sequence[int]]) -> Iterator[Rows]:
    """The same by a client that is there already (`connected`)."""
    from distributed import CancelledError, as_completed
    from distributed.comm import CommClosedError

    # A key of its own: the same spec of an earlier call may be let go of at this very moment.
    shared = client.scatter(spec, broadcast=True, hash=False)
    futures = {client.submit(_fly, shared, list(n), pure=False): list(n) for n in todo}
    coming = as_completed(futures, loop=client.loop)
    try:
        for future in coming:
            numbers = futures.pop(future)
            rows, again = _taken(spec, future, numbers)
            for number in again:
                new = client.submit(_fly, shared, [number], pure=False)
                futures[new] = [number]
                coming.add(new)
            if rows:
                yield rows
    except (CancelledError, CommClosedError, TimeoutError, OSError):
        raise FlightError(_GONE) from None


def _taken(spec: Spec, future: Any, numbers: list[int]) -> tuple[Rows, list[int]]:
    """Rows of a task, or what to fly again, one by one, as its process has ended too often."""
    from distributed import KilledWorker

    try:
        commit, rows = future.result()
    except KilledWorker:
        return ([], numbers) if len(numbers) > 1 else ([killed(spec, numbers[0])], [])
    _check_commit(commit, future.key)
    return rows, []


def _fly(spec: Spec, numbers: list[int]) -> tuple[str, Rows]:
    return sources_commit(), fly_rows(spec, numbers)


def _check_commit(commit: str, where: str) -> None:
    if commit != sources_commit():
        raise ParameterError(
            f"--scheduler: {where}: a worker flies the sources of {commit}, these are "
            f"{sources_commit()}; allowed: the same on all"
        )


@contextlib.contextmanager
def connected(workers: int, scheduler: str | None) -> Iterator[Any]:
    """A client of a cluster, as `fly_by_dask` takes it, which ends with it if it is its own."""
    from distributed import Client, LocalCluster

    # The matrices are small: threads of the linear algebra only cost time. The workers inherit it.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # What happens to the cluster is said in our own sentences.
    for name in [*logging.root.manager.loggerDict, "asyncio", "tornado"]:
        if name.partition(".")[0] in ("asyncio", "distributed", "tornado"):
            logging.getLogger(name).handlers = [logging.NullHandler()]
            logging.getLogger(name).propagate = False
    with contextlib.ExitStack() as ends:
        if scheduler is None:
            # Workers inherit that SIGINT is blocked, those that are started anew, too: Ctrl-C goes
            # to all processes of a terminal, and this one ends the others. The tracker unblocks it
            # in the thread that starts it.
            resource_tracker.ensure_running()
            with interrupts.held_back():
                cluster = LocalCluster(
                    n_workers=workers, threads_per_worker=1, processes=True,
                    dashboard_address=":0", silence_logs=_SILENT, config=_UNPROFILED,
                )  # fmt: skip
                address = ends.enter_context(cluster)
        else:
            address = scheduler
        try:
            client = Client(address, timeout=_REACH_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise ParameterError(
                f"--scheduler {scheduler}: {' '.join(str(error).split())}; allowed: the address of "
                "a scheduler that runs, such as tcp://127.0.0.1:8786"
            ) from None
        ends.enter_context(client)
        if scheduler is not None:
            for where, commit in client.run(sources_commit).items():
                _check_commit(commit, where)
        yield client
