#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Endurance: memory of a long flight, what it records and leaves, many starts, many Ctrl-C.

    ./heli python benchmarks/soak.py [--seconds S] [--realtime-seconds S] [--starts N]
                                     [--interrupts N] [--seed N] [--quick] [--json]

One flight in lockstep and one in real time, through the graph and recorded: the resident memory of
each process over flight time, its slope fitted after the first third; its open files and threads;
messages of the bag beside the topics' schedule; what stays in /dev/shm, in the folder of temporary
files, and of processes. Then flights of a second, one after the other, and flights that get Ctrl-C
at random times.
"""

import argparse
import contextlib
import json
import os
import random
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import ring
from latency import family

from heli_bags.tools import bag_info
from heli_core.ticks import OF_100_HZ
from heli_msgs_bridge import topics

SECONDS, REALTIME_SECONDS, STARTS, INTERRUPTS = 3600.0, 1200.0, 100, 50
QUICK = (20.0, 4.0, 1, 2)
_PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 1e6
_SAMPLES = 400
_LIMIT_S = 120.0
_LONGEST_WAIT_S = 12.0


def flight_command(folder: Path, seconds: float, *words: str) -> list[str]:
    """Of a recorded flight through the graph without a report."""
    command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report"]
    command += ["--world", "paper", "--seed", "1", "--duration", str(seconds)]
    return [*command, *words, "--out", str(folder)]


def name_of(pid: int) -> str:
    """What a process of a flight is: that of the log that it writes; all are forks of one."""
    with contextlib.suppress(OSError):
        log = Path(f"/proc/{pid}/fd/1").readlink()
        if log.suffix == ".log":
            return log.stem
    return f"hover_test {Path(f'/proc/{pid}/comm').read_text().strip()}"


def resident_mb(pid: int) -> float:
    """Resident memory of a process, MB."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE_MB


def held(pid: int) -> tuple[int, int]:
    """Open files and threads of a process."""
    process = Path(f"/proc/{pid}")
    return len(list((process / "fd").iterdir())), len(list((process / "task").iterdir()))


def in_shared_memory() -> set[str]:
    """What DDS keeps in shared memory; of ports (RTPS 9.6.1.1) only those of this domain."""
    found = {str(path) for path in Path("/dev/shm").iterdir() if "fast" in path.name}
    first = 7400 + 250 * int(os.environ.get("ROS_DOMAIN_ID", "0"))
    ports = {path: re.search(r"_port(\d+)", path) for path in found}
    return {path for path, port in ports.items() if not port or 0 <= int(port[1]) - first < 250}


def in_use() -> set[str]:
    """Files of /dev/shm that living processes, perhaps of other flights, map or have open."""
    used = set()
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            maps = (process / "maps").read_text().splitlines()
            used |= {line[line.index("/dev/shm") :] for line in maps if "/dev/shm" in line}
        with contextlib.suppress(OSError):
            for link in (process / "fd").iterdir():
                with contextlib.suppress(OSError):
                    used.add(str(link.readlink()))
    return used


def busy_s() -> tuple[float, float]:
    """Processor time, s, that this machine has spent, and that of it of what is run here."""
    jiffies = Path("/proc/stat").read_text().split(maxsplit=9)[1:9]
    user, nice, system, _, _, irq, softirq, steal = map(int, jiffies)
    spent_s = (user + nice + system + irq + softirq + steal) / os.sysconf("SC_CLK_TCK")
    own = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return spent_s, sum(used.ru_utime + used.ru_stime for used in own)


class Leftovers:
    """Files that flights make between `with` and `found`, and nobody uses any more.

    Attributes
    ----------
    folder : Path
        Where flights write; also their folder of temporary files.
    found : list of str
        Known at the end.
    beside : float
        Cores that others kept busy meanwhile; known at the end.
    """

    def __enter__(self) -> "Leftovers":
        self._place = tempfile.TemporaryDirectory(prefix="soak_")
        self.folder, self.found = Path(self._place.name), []
        self._passing = self.folder / "tmp"
        self._passing.mkdir()
        self.environment = {**os.environ, "TMPDIR": str(self._passing)}
        self._before = in_shared_memory()
        self._begun_s, self._busy_s = time.monotonic(), busy_s()
        return self

    def __exit__(self, *_: object) -> None:
        spent_s, own_s = (now - then for now, then in zip(busy_s(), self._busy_s, strict=True))
        self.beside = (spent_s - own_s) / (time.monotonic() - self._begun_s)
        shared = in_shared_memory() - self._before
        passing = [f"TMPDIR/{path.name}" for path in self._passing.iterdir()]
        self.found += sorted(shared - in_use()) + sorted(passing)
        self._place.cleanup()


def slope_per_hour(hours: list[float], mb: list[float]) -> float:
    """MB per hour by least squares, the first third left out; NaN for too few."""
    first = len(hours) // 3
    if len(hours) - first < 3:
        return float("nan")
    return float(np.polyfit(hours[first:], mb[first:], 1)[0])


def expected(name: str, ticks: int) -> int | None:
    """Messages of a topic in a flight of so many ticks; None where there is no schedule."""
    topic = topics.BY_NAME[name]
    if topic.every_ticks == 0 or topic.optional:
        return None
    return len(range(0, ticks, topic.every_ticks))


def missing_from_bag(folder: Path, ticks: int) -> dict[str, list[int]]:
    """Topics whose count in the bag is not that of the schedule: there, and due."""
    found = {row.topic.lstrip("/"): row.messages for row in bag_info(folder).topics}
    wrong = {}
    for topic in topics.TABLE:
        due = expected(topic.name, ticks)
        there = found.get(topic.name.lstrip("/"))
        if there is not None:
            there += sum(found.get(t.name, 0) for t in topics.TABLE if topic.name in t.replaces)
        if due is not None and there is not None and there != due:
            wrong[topic.name] = [there, due]
    return wrong


def sampled(flying: "subprocess.Popen[bytes]", log: Path, pause_s: float) -> dict[str, Any]:
    """By process, from take-off to the end: times, s of wall; memory, MB; open files; threads."""
    while not (log.is_file() and "flying" in log.read_text()) and flying.poll() is None:
        time.sleep(0.05)
    pids = {name_of(pid): pid for pid in family(flying.pid)}
    rows: dict[str, Any] = {name: ([], [], [], []) for name in pids}
    while flying.poll() is None and "over after" not in log.read_text():
        for name, pid in pids.items():
            with contextlib.suppress(OSError):
                values = time.monotonic(), resident_mb(pid), *held(pid)
                for row, value in zip(rows[name], values, strict=True):
                    row.append(value)
        time.sleep(pause_s)
    return {name: row for name, row in rows.items() if row[0]}


def memory_of(rows: dict[str, Any], seconds: float) -> dict[str, dict[str, Any]]:
    """By process: resident memory, MB, and its slope per hour of flight; open files and threads."""
    begun_s = min(row[0][0] for row in rows.values())
    flown_s = max(row[0][-1] for row in rows.values()) - begun_s
    scale = seconds / max(flown_s, 1e-3) / 3600.0
    told = {}
    for name, (times, values, files, threads) in sorted(rows.items()):
        hours = [(at - begun_s) * scale for at in times]
        slope = slope_per_hour(hours, values)
        told[name] = {
            "first_mb": values[0], "last_mb": values[-1], "slope_mb_per_h": slope,
            "files": [files[0], max(files), files[-1]],
            "threads": [threads[0], max(threads), threads[-1]],
        }  # fmt: skip
    return told


def long_flight(seconds: float, *words: str) -> dict[str, Any]:
    """Memory over a flight, and what it recorded and left."""
    pause_s = max(0.2, seconds / (_SAMPLES if "--realtime" in words else 5.0 * _SAMPLES))
    with Leftovers() as left:
        folder, begun_s = left.folder / "flight", time.monotonic()
        flying = subprocess.Popen(
            flight_command(folder, seconds, *words), stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE, env=left.environment,
        )  # fmt: skip
        rows = sampled(flying, folder / "logs" / "plant.log", pause_s)
        said = flying.communicate(timeout=_LIMIT_S + seconds / 10.0)[1].decode()
        if flying.returncode not in (0, 1):
            raise SystemExit(f"soak: {said.strip()}")
        wall_s = time.monotonic() - begun_s
        wrong = missing_from_bag(folder, OF_100_HZ.ticks_in(seconds))
    return {
        "seconds": seconds, "wall_s": wall_s, "exit_code": flying.returncode,
        "memory": memory_of(rows, seconds), "wrong_counts": wrong, "left": left.found,
        "beside": left.beside,
    }  # fmt: skip


def starts(count: int) -> dict[str, Any]:
    """Flights of one second, one after the other."""
    walls, codes = [], []
    with Leftovers() as left:
        for number in range(count):
            begun_s = time.monotonic()
            command = flight_command(left.folder / str(number), 1.0)
            done = subprocess.run(
                command, capture_output=True, timeout=_LIMIT_S, env=left.environment
            )
            walls.append(time.monotonic() - begun_s)
            codes.append(done.returncode)
            print(f"start {number + 1} of {count}", end="\r", file=sys.stderr, flush=True)
    return {
        "count": count, "odd_exit_codes": sorted({code for code in codes if code != 0}),
        "median_s": float(np.median(walls)), "longest_s": max(walls), "left": left.found,
        "beside": left.beside,
    }  # fmt: skip


def _heeds_interrupts() -> None:
    """What a shell starts with `&` ignores Ctrl-C, and so would what is started from here."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def interrupted(command: list[str], after_s: float, environment: dict[str, str]) -> int | None:
    """Exit code of a flight that gets Ctrl-C, as a terminal sends it; None: it hung.

    As a shell tells it: 130 for one that SIGINT has ended, too, before Python could take it.
    """
    flying = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        env=environment, preexec_fn=_heeds_interrupts,
    )  # fmt: skip
    time.sleep(after_s)
    os.killpg(flying.pid, signal.SIGINT)
    try:
        code = flying.wait(_LIMIT_S)
        return 128 - code if code < 0 else code
    except subprocess.TimeoutExpired:
        os.killpg(flying.pid, signal.SIGKILL)
        flying.wait()
        return None


def interrupts(count: int, seed: int) -> dict[str, Any]:
    """Flights that get Ctrl-C after a random time."""
    draw = random.Random(seed)
    codes, ends = [], []
    with Leftovers() as left:
        for number in range(count):
            after_s, begun_s = draw.uniform(0.0, _LONGEST_WAIT_S), time.monotonic()
            command = flight_command(left.folder / str(number), 3000.0)
            codes.append(interrupted(command, after_s, left.environment))
            ends.append(time.monotonic() - begun_s - after_s)
            print(f"interrupt {number + 1} of {count}", end="\r", file=sys.stderr, flush=True)
    return {
        "count": count, "seed": seed, "hung": codes.count(None),
        "odd_exit_codes": sorted({code for code in codes if code not in (130, None)}),
        "median_s": float(np.median(ends)), "longest_s": max(ends), "left": left.found,
        "beside": left.beside,
    }  # fmt: skip


def show(found: dict[str, Any]) -> None:
    """Print it for a reader."""
    for name in ("lockstep", "realtime"):
        flight = found[name]
        print(f"{name}: {flight['seconds']:g} s in {flight['wall_s']:.0f} s of wall time")
        for process, row in flight["memory"].items():
            print(
                f"  {process:12s} {row['first_mb']:7.1f} MB to {row['last_mb']:7.1f} MB, "
                f"{row['slope_mb_per_h']:+.2f} MB per hour of flight; first, most and last of open "
                f"files {row['files']}, of threads {row['threads']}"
            )
        print(f"  counts that are not the schedule's: {flight['wrong_counts'] or 'none'}")
        print(f"  left behind: {', '.join(flight['left']) or 'nothing'}")
        print(f"  beside it {flight['beside']:.2f} cores were busy")
    for name in ("starts", "interrupts"):
        print(f"{name}: {found[name]}")


def main() -> int:
    """Run all of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--realtime-seconds", type=float, default=REALTIME_SECONDS)
    parser.add_argument("--starts", type=int, default=STARTS)
    parser.add_argument("--interrupts", type=int, default=INTERRUPTS)
    parser.add_argument("--seed", type=int, default=1, help="of the times of Ctrl-C")
    parser.add_argument("--quick", action="store_true", help="seconds instead of hours")
    parser.add_argument("--json", action="store_true", help="print JSON")
    asked = parser.parse_args()
    sizes = (asked.seconds, asked.realtime_seconds, asked.starts, asked.interrupts)
    long_s, realtime_s, start_count, interrupt_count = QUICK if asked.quick else sizes
    ring.use_free_domain()
    found = {
        "lockstep": long_flight(long_s),
        "realtime": long_flight(realtime_s, "--realtime"),
        "starts": starts(start_count),
        "interrupts": interrupts(interrupt_count, asked.seed),
    }
    if asked.json:
        print(json.dumps(found))
    else:
        show(found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
