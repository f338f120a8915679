# SPDX-License-Identifier: Apache-2.0
"""Tables, progress and output folders of the commands: for people at a terminal and for pipes."""

import contextlib
import json
import math
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich import box
from rich.cells import cell_len
from rich.columns import Columns
from rich.console import Console, ConsoleOptions, RenderResult
from rich.padding import Padding
from rich.table import Column, Table
from rich.text import Text

from heli_core.rcl_yaml import ParameterError
from heli_flight import interrupts

# -------------------------------------------------------------------------------------------------
# Tables that never cut a number: where it is narrow they break lines, turn, or fall apart.
# -------------------------------------------------------------------------------------------------


class FittingTable(Table):
    """A table that is laid out for the width that there is; lines break between words only.

    As it was built if that fits with broken lines in its head and first column at most; else with
    rows and columns exchanged; else row by row.
    """

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for table in (self, self._turned()):
            widths = _widths(table, options.max_width)
            if widths:
                for column, width in zip(table.columns, widths, strict=True):
                    column.width, column.no_wrap = width, False
                yield from Table.__rich_console__(table, console, options)
                return
        yield from self._row_by_row()

    def _turned(self) -> Table:
        turned = Table(title=self.title, title_justify="left", box=self.box)
        first, *others = self.columns
        turned.add_column(first.header)
        for name in first.cells:
            turned.add_column(name, justify="right")
        for column in others:
            turned.add_row(column.header, *column.cells)
        return turned

    def _row_by_row(self) -> RenderResult:
        if self.title:
            yield Text(str(self.title), style="italic")
        heads = [str(column.header) for column in self.columns[1:]]
        for name, *cells in zip(*(column.cells for column in self.columns), strict=True):
            yield Text(str(name), style="bold", overflow="fold")
            labelled = [
                Text(f"{head}: {cell}" if head else str(cell), overflow="fold")
                for head, cell in zip(heads, cells, strict=True)
                if str(cell)
            ]
            yield Padding(Columns(labelled, equal=True, padding=(0, 3, 0, 0)), (0, 0, 0, 2))


def _widths(table: Table, room: int) -> list[int]:
    """Widths of the columns in so many characters; empty if that is too little room."""
    # Two blanks and a frame for each column, and one frame more.
    room -= 3 * len(table.columns) + 1
    wide = [_longest([str(column.header), *map(str, column.cells)]) for column in table.columns]
    widths = [_least(column, names=i == 0) for i, column in enumerate(table.columns)]
    if sum(widths) > room:
        return []
    while sum(widths) < min(room, sum(wide)):
        lacking = [want - have for want, have in zip(wide, widths, strict=True)]
        widths[lacking.index(max(lacking))] += 1
    return widths


def _least(column: Column, names: bool) -> int:
    """What a column needs at least: words of its head, and its cells; of names words, too."""
    cells = list(map(str, column.cells))
    words = [word for cell in cells for word in cell.split()]
    return _longest([*str(column.header).split(), *(words if names else cells)])


def _longest(texts: Iterable[str]) -> int:
    return max(map(cell_len, texts), default=0)


# -------------------------------------------------------------------------------------------------
# Terminal.
# -------------------------------------------------------------------------------------------------

_WIDTH_OF_PIPE = 250
# Of more than so many steps only some move the bar: moving it costs more than many of them.
_MANY, _EVERY = 1000, 100


def console(stderr: bool = False) -> Console:
    """A console that keeps whole lines where there is no terminal."""
    stream = sys.stderr if stderr else sys.stdout
    return Console(
        stderr=stderr, width=None if stream.isatty() else _WIDTH_OF_PIPE, highlight=False
    )


def table(title: str, out: Console) -> FittingTable:
    """A table that cuts no number; with frames at a terminal, in Markdown elsewhere."""
    frame = box.HEAVY_HEAD if out.is_terminal else box.MARKDOWN
    return FittingTable(title=title, title_justify="left", box=frame)


def silent() -> Console:
    """A console that nobody sees."""
    return Console(quiet=True, force_terminal=False)


def steps(what: str, total: int) -> contextlib.AbstractContextManager[Callable[[float], None]]:
    """Progress on stderr: gives a function that takes how many steps are done.

    A bar at a terminal, elsewhere a line at every fifth.
    """
    counted = "{task.completed:.0f}/{task.total:.0f}"
    return _progress(
        console(stderr=True), what, total, counted, 5, lambda done: f"{what}: {done} of {total}"
    )


@contextlib.contextmanager
def in_turn() -> Iterator[Callable[[str, int, int], None]]:
    """Progress of pieces of work one after the other: a function of what, steps done and total."""
    with contextlib.ExitStack() as shown:
        now: dict[str, Callable[[float], None]] = {}

        def tell(what: str, done: int, total: int) -> None:
            if what not in now:
                shown.close()
                now[what] = shown.enter_context(steps(what, total))
            now[what](done)

        yield tell


def flight_time(
    out: Console, duration_s: float
) -> contextlib.AbstractContextManager[Callable[[float], None]]:
    """Progress of a flight: gives a function that takes the flight time, s.

    A bar at a terminal, elsewhere a line at every tenth.
    """
    counted = "{task.completed:.1f}/{task.total:.0f} s flown"

    def line(done_s: float) -> str:
        return f"flown {done_s:.0f} s of {duration_s:.0f} s"

    return _progress(out, "flight", duration_s, counted, 10, line)


@contextlib.contextmanager
def _progress(
    out: Console,
    what: str,
    total: float,
    counted: str,
    parts: int,
    line: Callable[[float], str],
) -> Iterator[Callable[[float], None]]:
    """A bar that says `counted`, or without a terminal a `line` at each of so many parts."""
    if not out.is_terminal:
        last_part = [0]

        def plain(done: float) -> None:
            part = int(parts * done / total)
            if part > last_part[0]:
                last_part[0] = part
                out.print(line(done), highlight=False)

        yield plain
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn(counted))
    with Progress(*columns, TimeElapsedColumn(), console=out) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done: bar.update(task, completed=done)


@contextlib.contextmanager
def long_steps(what: str, total: int, begun: int = 0) -> Iterator[Callable[[int, str], None]]:
    """Progress on stderr of work of hours: gives a function that takes steps done and a remark.

    With rate and time left; `begun` steps were there before. A bar at a terminal, elsewhere a line
    at every fifth.
    """
    since, latest = time.monotonic(), {"remark": ""}

    def pace(done: float) -> str:
        rate = (done - begun) / max(time.monotonic() - since, 1e-9)
        left_s = (total - done) / rate if rate > 0.0 else math.inf
        left = f"{left_s / 60.0:.1f} min" if left_s < 7200.0 else f"{left_s / 3600.0:.1f} h"
        return f"{rate:.1f} per second, {left} left, {latest['remark']}"

    def line(done: float) -> str:
        return f"{what}: {done:.0f} of {total}, {pace(done)}"

    out = console(stderr=True)
    if out.is_terminal:
        from rich.progress import BarColumn, Progress, TextColumn

        columns = (
            TextColumn("{task.description}"), BarColumn(),
            TextColumn("{task.completed:.0f}/{task.total:.0f}, {task.fields[pace]}"),
        )  # fmt: skip
        with Progress(*columns, console=out) as bar:
            task = bar.add_task(what, total=total, completed=begun, pace="")

            def move(done: int, remark: str) -> None:
                latest["remark"] = remark
                bar.update(task, completed=done, pace=pace(done))

            yield move
        return
    with _progress(out, what, total, "", 5, line) as plain:

        def tell(done: int, remark: str) -> None:
            latest["remark"] = remark
            plain(done)

        yield tell


@contextlib.contextmanager
def amount(what: str) -> Iterator[Callable[[int, int], None]]:
    """Progress on stderr of work that may be short: gives a function that takes done and total.

    Nothing is shown in the first second; then a bar at a terminal, elsewhere a line at every fifth.
    A total of 0 says that it is not known yet.
    """
    begun, shown = time.monotonic(), contextlib.ExitStack()
    now: dict[int, Callable[[int], None]] = {}
    last_done = [0]

    def update(done: int, total: int) -> None:
        if total > _MANY and done % _EVERY:
            return
        if done == last_done[0] or not total or time.monotonic() - begun < 1.0:
            return
        last_done[0] = done
        if total not in now:
            now[total] = shown.enter_context(steps(what, total))
        now[total](done)

    with shown:
        yield update


PATIENCE_S = 2.0
"""So long nothing is said."""


@contextlib.contextmanager
def told_when_long(
    what: str, quiet: bool = False, after_s: float = PATIENCE_S
) -> Iterator[Callable[[str], None]]:
    """Gives a function that takes what comes next; it is said on stderr once the call is long.

    Parameters
    ----------
    what : str
        The call.
    quiet : bool
        True: nothing is said.
    after_s : float
        So long nothing is said; then what is under way, and each that follows.
    """
    if quiet:
        yield lambda _: None
        return
    out, lock = console(stderr=True), threading.Lock()
    now, long = [""], threading.Event()

    def say() -> None:
        if now[0]:
            out.print(f"{what}: {now[0]} ...", highlight=False, soft_wrap=True, markup=False)

    def begin_to_say() -> None:
        with lock:
            long.set()
            say()

    def tell(step: str) -> None:
        with lock:
            now[0] = step
            if long.is_set():
                say()

    timer = threading.Timer(after_s, begin_to_say)
    timer.daemon = True
    timer.start()
    try:
        yield tell
    finally:
        timer.cancel()


def told_at_terminal(what: str) -> contextlib.AbstractContextManager[Callable[[str], None]]:
    """The same of a command: where stderr is no terminal nothing is said."""
    return told_when_long(what, quiet=not console(stderr=True).is_terminal)


def refuse_existing(path: Path | None) -> None:
    """Refuse a folder for --out that exists, before anything long is done.

    Raises
    ------
    ParameterError
    """
    if path is not None and path.exists():
        raise ParameterError(f"--out {path}: exists already; name a new folder")


def _new_folder(path: Path) -> Path:
    """Make the folder that --out names.

    Raises
    ------
    ParameterError
        It exists already, or cannot be written.
    """
    refuse_existing(path)
    try:
        path.mkdir(parents=True)
    except OSError as error:
        raise ParameterError(f"--out {path}: cannot be written: {error.strerror}") from None
    return path


@dataclass
class NewFolder:
    """A folder that is being filled; it goes if that fails, unless `stays` has been set."""

    path: Path
    stays: bool = False


@contextlib.contextmanager
def being_filled(path: Path) -> Iterator[NewFolder]:
    """Make the folder that --out names; take it away again if what fills it fails.

    Raises
    ------
    ParameterError
        It exists already, or cannot be written.
    """
    folder = NewFolder(path)
    missing = [parent for parent in path.parents if not parent.exists()]
    with contextlib.ExitStack() as undo:
        with interrupts.held_back():
            _new_folder(path)
            undo.callback(_discard, folder, missing)
        yield folder
        folder.stays = True


def _discard(folder: NewFolder, parents: Sequence[Path]) -> None:
    """Remove the folder, and of the parents that were made with it those that are empty."""
    if folder.stays:
        return
    shutil.rmtree(folder.path, ignore_errors=True)
    with contextlib.suppress(OSError):
        for parent in parents:
            parent.rmdir()


def json_text(content: Any) -> str:
    """Content as JSON: indented, None for what is not finite."""
    return json.dumps(_plain(content), indent=2, allow_nan=False) + "\n"


def answer(content: Any, as_json: bool, show: Callable[[Console], None], below: str = "") -> int:
    """Print what a command found: JSON, or what `show` prints and a line below; exit code 0."""
    if as_json:
        print(json_text(content), end="")
        return 0
    show(console())
    if below:
        console().print(below)
    return 0


def _plain(content: Any) -> Any:
    """The content with None for what is not finite: JSON has no such numbers."""
    if isinstance(content, dict):
        return {key: _plain(value) for key, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [_plain(value) for value in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content
