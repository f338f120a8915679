# SPDX-License-Identifier: Apache-2.0
"""How pictures look: fit for a paper, colours that the colour-blind can tell apart (Okabe and Ito).

Lines also differ in style, so that they can be told apart in print.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

from matplotlib import pyplot as plt  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402

BLUE, ORANGE, GREEN, RED, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#666666"

_RC: Any = {
    "font.family": "serif",
    "font.serif": ["STIXGeneral", "DejaVu Serif"],
    "mathtext.fontset": "stix",
    "font.size": 10,
    "axes.titlesize": 10,
    "axes.labelsize": 10,
    "legend.fontsize": 9,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
    "lines.linewidth": 1.2,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.5,
    "axes.axisbelow": True,
    "legend.frameon": True,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "none",
    "savefig.dpi": 200,
    "figure.constrained_layout.use": True,
}


@contextlib.contextmanager
def picture(
    path: Path, rows: int, columns: int, size_in: tuple[float, float], **options
) -> Iterator:
    """Give a figure and its axes (rows, columns), write it to path at the end."""
    with plt.rc_context(_RC):
        figure, axes = plt.subplots(rows, columns, figsize=size_in, squeeze=False, **options)
        yield figure, axes
        figure.savefig(path)
        _close(figure)


def _close(figure: Figure) -> None:
    plt.close(figure)
