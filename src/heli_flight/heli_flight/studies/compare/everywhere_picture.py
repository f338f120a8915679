# SPDX-License-Identifier: Apache-2.0
"""The picture of `heli compare laws`: median and worst of each law at each place."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.ticker import LogLocator

from heli_flight.report.plot_style import picture
from heli_flight.studies.compare.laws import AXES

_MARKS = "osD^vP*X"


def draw(content: Mapping[str, Any], path: Path) -> None:
    """Write it from what `heli compare laws --json` says: a column of marks per place."""
    names = [place["name"] for place in content["places"]]
    laws = content["laws"]
    with picture(path, len(AXES), 1, (1.1 * len(names) + 1.5, 6.0), sharex=True) as (figure, axes):
        for (axis,), key in zip(axes, AXES, strict=True):
            for number, law in enumerate(laws):
                rows = [r for r in content["rows"] if (r["law"], r["axis"]) == (law, key)]
                x = np.arange(len(rows)) + 0.8 * ((number + 0.5) / len(laws) - 0.5)
                worst = np.array([r["worst_deg"] for r in rows], float)
                median = np.array([r["median_deg"] for r in rows], float)
                colour = colormaps["tab10"](number)
                axis.vlines(x, median, worst, color=colour, lw=1.0)
                axis.plot(x, worst, "_", color=colour, ms=6)
                mark = _MARKS[number % len(_MARKS)]
                axis.plot(x, median, mark, color=colour, ms=4, label=law)
            axis.set_yscale("log")
            axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.yaxis.set_major_formatter("{x:g}")
            axis.yaxis.set_minor_formatter("")
            axis.set_ylabel(f"largest {key} error (deg)")
            axis.set_xticks(range(len(names)), [name.replace(", ", "\n") for name in names])
            axis.grid(False, axis="x")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        title = "Mark: median over the flights; line: up to the worst"
        figure.legend(handles, labels, loc="outside upper center", ncols=len(laws), title=title)
