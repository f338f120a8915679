# SPDX-License-Identifier: Apache-2.0
"""The paper's Fig. 3 and 4 side by side: roll and pitch under the laws, same wind, same seed."""

from pathlib import Path

import numpy as np

from heli_flight.loop.result import mean_wind
from heli_flight.report.plot_style import BLUE, GREY, ORANGE, RED, picture
from heli_flight.studies.compare.attitude import PAPER_DEG, Comparison
from heli_flight.studies.compare.laws import AXES, attitude_errors_deg

_COLOURS = {"pid": RED, "lqr": ORANGE}


def draw(result: Comparison, path: Path) -> None:
    """Write the picture of the first seed; PID on the left, as in the paper."""
    laws = sorted(result.laws, key=lambda law: law.key != "pid")
    size = (3.0 * len(laws) + 0.8, 4.2)
    with picture(path, 2, len(laws), size, sharex=True, sharey="row") as (figure, axes):
        for column, law in zip(axes.T, laws, strict=True):
            record = result.shown[law.key].record
            truth = attitude_errors_deg(record, "truth")
            told = attitude_errors_deg(record, "navigation")
            for i, axis in enumerate(column):
                _gusts(axis, result)
                axis.plot(record.time_s, truth[:, i], color=GREY, lw=0.8, label="ground truth")
                colour = _COLOURS.get(law.key, BLUE)
                axis.plot(
                    record.time_s, told[:, i], color=colour, lw=0.9, label="navigation record"
                )
            paper = PAPER_DEG.get(law.key)
            note = f"\n(paper, in flight: ±{paper:g}°)" if paper else "\n"
            column[0].set_title(law.name + note)
            column[1].set_xlabel("time (s)")
            column[0].set_xlim(0.0, record.time_s[-1])
        for i, name in enumerate(AXES):
            axes[i, 0].set_ylabel(f"{name} error (deg)")
            bound = 1.2 * _largest_scored(result, i)
            axes[i, 0].set_ylim(-bound, bound)
        axes[1, -1].legend(loc="lower right", ncols=2)
        figure.suptitle(_title(result), fontsize=10)


def _largest_scored(result: Comparison, axis: int) -> float:
    """Largest error (deg) that is scored, over the shown flights; at least 0.05."""
    found = [0.05]
    for flight in result.shown.values():
        mask = result.settings.scenario.scored(flight.record.time_s)
        for source in ("navigation", "truth"):
            error = attitude_errors_deg(flight.record, source)[mask, axis]
            found.append(float(np.abs(error).max(initial=0.0)))
    return max(found)


def _gusts(axis, result: Comparison) -> None:
    """Shade the discrete gusts."""
    p = result.settings.nodes["plant"]
    peaks = np.linalg.norm(np.reshape(p["wind.gust.amplitude_mps"], (-1, 3)), axis=1)
    for start, length, peak in zip(
        p["wind.gust.start_s"], p["wind.gust.duration_s"], peaks, strict=True
    ):
        if peak > 0.0:
            axis.axvspan(start, start + length, color="#eeeeee", lw=0)


def _title(result: Comparison) -> str:
    p = result.settings.nodes["plant"]
    peak = np.linalg.norm(np.reshape(p["wind.gust.amplitude_mps"], (-1, 3)), axis=1).max()
    gusts = f", discrete gusts up to {peak:.3g} m/s (shaded)" if peak > 0.0 else ""
    turbulence = " with turbulence" if p["wind.turbulence"] else ""
    begin = np.ravel(result.settings.scenario.windows_s)[0]
    return (
        f"Simulated: wind {mean_wind(p)}{turbulence}{gusts}; seed {result.seeds[0]}; "
        f"scored from {begin:g} s on"
    )
