# SPDX-License-Identifier: Apache-2.0
"""The node processes of a flight: started together, watched, and never left behind."""

import contextlib
import ctypes
import fcntl
import importlib
import multiprocessing
import os
import signal
import socket
import stat
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from multiprocessing import forkserver, resource_tracker, util
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from heli_core.errors import NO_ROS, StartError
from heli_flight import interrupts

_PR_SET_PDEATHSIG = 1
# Set in the process that nodes are forked from, to its own id; and to that of its parent.
SERVER_PID = "HELI_SERVER_PID"
STARTER_PID = "HELI_STARTER_PID"
# Nodes end in a fraction of a second; seven of them at once on a loaded machine take longer.
_STOP_LIMIT_S = 10.0  # on loaded cores some seconds are needed
_LOG_TAIL_BYTES = 4096
# Above it Fast DDS runs out of port numbers.
_MAX_DOMAIN = 232
# Above it ports are those that Linux gives to clients.
_CHOSEN_DOMAINS = 102
DOMAIN = "ROS_DOMAIN_ID"
DISCOVERY = "ROS_AUTOMATIC_DISCOVERY_RANGE"
# Of rcl's four values the one with which nodes of one machine find each other by nothing at all.
_RANGES, _NO_RANGE = ("LOCALHOST", "SUBNET", "SYSTEM_DEFAULT"), "OFF"
# UDP ports of a ROS domain (DDSI-RTPS 2.3, 9.6.1.1): the first, and how many.
_FIRST_PORT, _PORTS = 7400, 250
_UDP_SOCKETS = Path("/proc/net/udp")
# What multiprocessing puts behind the temporary folder, and the longest path of a Unix socket that
# all systems take (108 bytes with the final zero on Linux, 104 on others).
_SOCKET_IN_FOLDER, _LONGEST_SOCKET = "/pymp-xxxxxxxx/listener-xxxxxxxx", 103
_SHORT_FOLDERS = ("/tmp", "/dev/shm", "/var/tmp")
SHARED_MEMORY = Path("/dev/shm")
"""Where POSIX shared memory lies (shm_overview(7))."""
_SHARED_MEMORY_BYTES = 8 * 2**20
"""The seven participants of a flight with its live view have 4.6 MB there."""
_TRACER = "/liblttng-ust-"
_TRACEPOINTS = "/liblttng-ust-tracepoint-"


def die_with_parent(parent: str) -> None:
    """Have the kernel end this process when its parent ends (Linux); end if it has already.

    Parameters
    ----------
    parent : str
        Name of the environment variable that holds the parent's process id.
    """
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.environ.get(parent, str(os.getppid())) != str(os.getppid()):
        sys.exit(1)


def _run_node(
    module: str,
    arguments: Sequence[str],
    log: str,
    env: Mapping[str, str],
    orders: Connection | None,
) -> None:
    """What a node's process does: own session, own log, then the executable's main()."""
    # A session of its own: Ctrl-C reaches the supervisor only, which then ends the nodes.
    os.setsid()
    die_with_parent(SERVER_PID)
    os.environ.update(env)
    with open(log, "ab", buffering=0) as stream, open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), 0)
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
    interrupts.take()
    sys.argv = [module, *arguments]
    more = [] if orders is None else [orders]
    sys.exit(importlib.import_module(module).main(list(arguments), *more))


def _short_sockets() -> None:
    """Have multiprocessing keep its sockets where their paths are short, whatever TMPDIR is.

    Their folder is made once in a process, for its user alone, and removed when the process ends.
    """
    before = tempfile.gettempdir()
    if len(os.fsencode(before + _SOCKET_IN_FOLDER)) <= _LONGEST_SOCKET:
        return
    usable = (path for path in _SHORT_FOLDERS if os.access(path, os.W_OK | os.X_OK))
    tempfile.tempdir = next(usable, before)
    try:
        util.get_temp_dir()
    finally:
        tempfile.tempdir = before


def start_server() -> None:
    """Start the process that loads what all nodes need once, and of which each node is a fork.

    Five interpreters that import NumPy, numba and rclpy and load the same compiled kernels would
    take twice as long on two cores. Call it early: it loads while the caller goes on.
    """
    multiprocessing.set_forkserver_preload(["heli_flight.graph.bound", "heli_flight.graph.preload"])
    os.environ[STARTER_PID] = str(os.getpid())
    _short_sockets()
    # The tracker, which the server needs, lets signals through when it has been started.
    resource_tracker.ensure_running()
    # A terminal's Ctrl-C goes to the server, too; its nodes take it up when they have their logs.
    with interrupts.held_back():
        forkserver.ensure_running()


@contextlib.contextmanager
def _main_left_out() -> Iterator[None]:
    """Keep multiprocessing from running the caller's main file again in each node.

    It does so for what only the main file defines, which no node needs; and the command `heli`, as
    pip installs it, would then start itself once more.
    """
    main = sys.modules["__main__"]
    kept: dict[str, Any] = {
        name: main.__dict__.pop(name) for name in ("__file__", "__spec__") if name in vars(main)
    }
    try:
        main.__spec__ = None
        yield
    finally:
        main.__dict__.update(kept)


class NodeProcess:
    """One running node with its log file.

    Parameters
    ----------
    name : str
    module : str
        Python module whose `main(arguments)` is the node's executable.
    arguments : sequence of str
        Command line.
    log : Path
        Gets what the node writes.
    env : mapping
        Environment to set.
    orders : Connection, optional
        A second argument of `main`, for a process that is to become something else.
    """

    def __init__(
        self,
        name: str,
        module: str,
        arguments: Sequence[str],
        log: Path,
        env: Mapping[str, str],
        orders: Connection | None = None,
    ):
        self.name = name
        self.log = log
        log.touch()
        context = multiprocessing.get_context("forkserver")
        work = (module, tuple(arguments), str(log.absolute()), dict(env), orders)
        self._process = context.Process(target=_run_node, args=work, name=name, daemon=True)
        with _main_left_out():
            self._process.start()

    @property
    def pid(self) -> int:
        """Process id."""
        pid = self._process.pid
        assert pid is not None, "started when it was made"
        return pid

    def exit_code(self) -> int | None:
        """Exit code, or None while it runs."""
        return self._process.exitcode

    def last_line(self) -> str:
        """Last line that the process wrote, for one-line error messages."""
        try:
            with open(self.log, "rb") as stream:
                stream.seek(0, os.SEEK_END)
                stream.seek(max(0, stream.tell() - _LOG_TAIL_BYTES))
                lines = stream.read().decode(errors="replace").strip().splitlines()
        except OSError:
            return ""
        return lines[-1].strip() if lines else ""

    def interrupt(self) -> None:
        """Ask it to end (SIGINT)."""
        with contextlib.suppress(ProcessLookupError):
            if self._process.exitcode is None:
                os.kill(self.pid, signal.SIGINT)

    def wait(self, limit_s: float) -> bool:
        """Wait until it has ended; False if it has not within limit_s."""
        self._process.join(max(limit_s, 0.0))
        return self._process.exitcode is not None

    def kill(self) -> None:
        """End it and whatever it started, now."""
        for end in (os.killpg, os.kill):
            # One that has just begun leads no group yet.
            with contextlib.suppress(ProcessLookupError, PermissionError):
                end(self.pid, signal.SIGKILL)
        self._process.join(_STOP_LIMIT_S)


def why_ended(process: NodeProcess, nodes: Sequence[str]) -> str:
    """Why a process ended, in its own last words, in front the name of the node or of all of it."""
    code = process.exit_code() or 0
    if code < 0:
        return f"{', '.join(nodes)}: killed by {signal.Signals(-code).name}"
    reason = process.last_line() or f"exit code {code}"
    prefixes = tuple(f"{name}: " for name in (process.name, *nodes))
    return reason if reason.startswith(prefixes) else f"{process.name}: {reason}"


def stop(processes: Sequence[NodeProcess], limit_s: float = _STOP_LIMIT_S) -> list[str]:
    """End processes together; returns the names of those that had to be killed."""
    for process in processes:
        process.interrupt()
    deadline = time.monotonic() + limit_s
    killed = []
    for process in processes:
        if not process.wait(deadline - time.monotonic()):
            process.kill()
            killed.append(process.name)
    return killed


def end_tracer() -> None:
    """End the threads of LTTng's tracer (lttng-ust), which rclpy's wheels bring along.

    Where its page of shared memory cannot be had, they fork every few seconds, and wait for
    whichever child ends first (`get_wait_shm` in lttng-ust 2.12): the end of a node that is a fork
    of this process, too, of which then nobody else hears. Forks of this process have no such
    threads. Call it when rclpy is imported. Tracing of this process ends with it.
    """
    try:
        lines = Path("/proc/self/maps").read_text().splitlines()
    except OSError:
        return
    paths = {line.split(maxsplit=5)[-1] for line in lines if _TRACER in line}
    for path in sorted(path for path in paths if _TRACEPOINTS not in path):
        ctypes.CDLL(path).lttng_ust_exit()


def has_shared_memory() -> bool:
    """Whether there is shared memory that this user can write to; Fast DDS uses UDP else."""
    return os.access(SHARED_MEMORY, os.W_OK | os.X_OK)


def check_middleware() -> None:
    """Raise StartError for an environment in which rcl or Fast DDS would end the whole process.

    ROS 2 must be installed at all.
    The library that RMW_IMPLEMENTATION names must be there; ROS_DOMAIN_ID must leave room for port
    numbers; nodes must be able to find each other; shared memory must have room: Fast DDS takes it
    without asking, and is ended by the kernel (SIGBUS) where there is none.
    """
    if find_spec("rclpy") is None:
        raise StartError(f"the ROS graph {NO_ROS}")
    domain = os.environ.get("ROS_DOMAIN_ID", "").strip()
    if domain and not (domain.isdecimal() and int(domain) <= _MAX_DOMAIN):
        raise StartError(
            f"ROS 2 cannot start with ROS_DOMAIN_ID={domain}: allowed are 0 to {_MAX_DOMAIN}"
        )
    _check_range()
    _check_shared_memory()
    name = os.environ.get("RMW_IMPLEMENTATION")
    if not name:
        return
    try:
        ctypes.CDLL(f"lib{name}.so")
    except OSError:
        raise StartError(
            f"ROS 2 cannot start with RMW_IMPLEMENTATION={name}: not installed"
        ) from None


def _check_shared_memory() -> None:
    """Raise StartError if it is full."""
    if not has_shared_memory():
        return
    status = os.statvfs(SHARED_MEMORY)
    free = status.f_bavail * status.f_frsize
    if free < _SHARED_MEMORY_BYTES:
        raise StartError(
            f"{SHARED_MEMORY}, the machine's shared memory, has {free / 2**20:.1f} MB free, and a "
            f"flight needs {_SHARED_MEMORY_BYTES / 2**20:.0f} MB; remove what is left there, or "
            "make it larger (a container's: --shm-size)"
        )


def _check_range() -> None:
    """Raise StartError for a range of discovery that is none, or with which none is found."""
    wanted = os.environ.get(DISCOVERY, "").strip()
    if wanted and wanted not in (*_RANGES, _NO_RANGE):
        # rcl would warn, deep in a log, and take another.
        raise StartError(f"{DISCOVERY}={wanted}: allowed are {', '.join(_RANGES)}")
    if wanted == _NO_RANGE and not os.environ.get("ROS_STATIC_PEERS", "").strip():
        raise StartError(
            f"{DISCOVERY}={wanted}: nodes do not find each other; allowed are {', '.join(_RANGES)}"
        )


def _lock_path(domain: int) -> Path:
    return Path(tempfile.gettempdir()) / f"heli_hover-domain-{domain}.lock"


def _is_file(descriptor: int, path: Path) -> bool:
    """Whether a path still names the file that is open: who held it last has removed it else."""
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except FileNotFoundError:
        return False


def _held_lock(domain: int) -> int | None:
    """Descriptor of a domain's lock, held by this process; None if another flight holds it.

    One file for all users of the machine: whoever made it, all may lock it. A lock counts as held
    only while its file has its name, so that its holder may remove the file.
    """
    path = _lock_path(domain)
    while True:
        lock = -1
        try:
            with contextlib.suppress(FileExistsError):
                os.close(os.open(path, os.O_RDONLY | os.O_CREAT | os.O_EXCL, 0o644))
            # What is no file, such as a FIFO that nobody writes to, must not hold the start.
            lock = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW)
            if not stat.S_ISREG(os.fstat(lock).st_mode):
                raise PermissionError(f"{path} is no file")
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _is_file(lock, path):
                return lock
        except FileNotFoundError:
            if not path.parent.is_dir():
                return None
        except OSError:
            if lock >= 0:
                os.close(lock)
            return None
        if lock >= 0:
            os.close(lock)


def _give_back(domain: int, lock: int) -> None:
    """Remove a lock's file while it is held, then let go; another user's file stays."""
    path = _lock_path(domain)
    with contextlib.suppress(OSError):
        if _is_file(lock, path):
            path.unlink()
    os.close(lock)


def _claimed(domain: int) -> socket.socket | None:
    """A name for a domain that one process has; None if another flight has it.

    The file of `_held_lock` lies in the folder of temporary files, which users may choose. This
    name is known wherever the domain's ports are (unix(7), abstract sockets), and ends with its
    process.
    """
    claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        claim.bind(f"\0heli_hover-domain-{domain}")
    except OSError:
        claim.close()
        return None
    return claim


def others_in(domain: int) -> bool:
    """Whether another DDS participant may be in a ROS domain: one of its ports is taken here.

    True also where the kernel does not tell.
    """
    first = _FIRST_PORT + _PORTS * domain
    try:
        sockets = _UDP_SOCKETS.read_text().splitlines()[1:]
    except OSError:
        return True
    # "sl local_address ...": address and port in hexadecimal.
    taken = (int(line.split()[1].rpartition(":")[2], 16) for line in sockets)
    return any(first <= port < first + _PORTS for port in taken)


@contextlib.contextmanager
def domain_reserved() -> Iterator[int]:
    """Hold a ROS domain for one flight on this machine: that of ROS_DOMAIN_ID, else a free one.

    Two graphs with the same names in one domain would command each other's nodes, and discovery is
    too slow to notice in time. Where ROS_DOMAIN_ID is not set, it is meanwhile.

    Raises
    ------
    StartError
        Another flight holds it.
    """
    wanted = os.environ.get(DOMAIN, "").strip()
    for domain in [int(wanted)] if wanted else range(_CHOSEN_DOMAINS):
        lock = _held_lock(domain)
        if lock is None:
            continue
        claim = _claimed(domain)
        if claim is not None:
            break
        _give_back(domain, lock)
    else:
        if not wanted:
            raise StartError(f"flights hold all ROS domains below {_CHOSEN_DOMAINS}")
        raise StartError(
            f"another hover test flies in ROS domain {wanted}; set {DOMAIN} to a free one, or do "
            "not set it"
        )
    if not wanted:
        os.environ[DOMAIN] = str(domain)
    try:
        yield domain
    finally:
        if not wanted:
            os.environ.pop(DOMAIN, None)
        claim.close()
        _give_back(domain, lock)
