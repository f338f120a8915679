# SPDX-License-Identifier: Apache-2.0
"""Tables that never cut a number: where it is narrow they break lines, turn, or fall apart."""

from collections.abc import Iterable

from rich.cells import cell_len
from rich.columns import Columns
from rich.console import Console, ConsoleOptions, RenderResult
from rich.padding import Padding
from rich.table import Column, Table
from rich.text import Text


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
            told = [
                Text(f"{head}: {cell}" if head else str(cell), overflow="fold")
                for head, cell in zip(heads, cells, strict=True)
                if str(cell)
            ]
            yield Padding(Columns(told, equal=True, padding=(0, 3, 0, 0)), (0, 0, 0, 2))


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
