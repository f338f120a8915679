# SPDX-License-Identifier: Apache-2.0
"""What `heli log info` prints and draws."""

from pathlib import Path

import numpy as np
from rich.console import Console
from scipy import signal as filters

from heli_analysis.identification.aperiodic import LEAST_COHERENCE
from heli_flight.report.figures import BLUE, GREEN, GREY, ORANGE, RED, picture
from heli_flight.terminal import table
from heli_studies.logs.info import LogInfo, on_grid
from heli_studies.logs.signals import SIGNALS

_COLOURS = (BLUE, RED, GREEN, ORANGE)


def print_info(info: LogInfo, out: Console) -> None:
    """Tables: messages, signals, inputs, answers, what follows."""
    log = info.log
    out.print(
        f"{log.path}: {log.format}, {log.size_bytes / 1e6:.2f} MB, {info.length_s:.1f} s",
        markup=False,
    )
    flaws = [
        f"{log.skipped_bytes} bytes belong to no message" if log.skipped_bytes else "",
        f"{log.dropped_s:.2f} s were not recorded" if log.dropped_s else "",
        "the last message is cut off" if log.cut else "",
        *(f"{n} rows of {name or 'the table'} left out" for name, n in log.left_out.items()),
    ]
    for flaw in filter(None, flaws):
        out.print(flaw, markup=False)
    shown = table("Messages", out)
    for name in ("message", "rows", "rate, 1/s", "longest step, s", "gaps"):
        shown.add_column(name, justify="left" if name == "message" else "right")
    for m in log.messages:
        gap = f"{m.longest_gap_s:.3g}"
        shown.add_row(m.name, str(m.rows), f"{m.rate_hz:.4g}", gap, str(m.gaps))
    out.print(shown)
    shown = table("Signals", out)
    for name in ("signal", "unit", "from", "rate, 1/s"):
        shown.add_column(name, justify="right" if name.startswith("rate") else "left")
    for s in log.signals.values():
        shown.add_row(s.name, SIGNALS[s.name].unit, s.source, f"{s.rate_hz:.4g}")
    out.print(shown)
    shown = table("Excitation: 90 % of an input's power", out)
    for name in ("input", "std", "from, Hz", "to, Hz", ""):
        shown.add_column(name, justify="left" if name in ("input", "") else "right")
    for i in info.inputs:
        low, high = (f"{f:.2g}" for f in i.band_hz) if i.band_hz else ("", "")
        remark = "swept" if i.swept else "" if i.moves else "does not move"
        shown.add_row(i.name, f"{i.std:.3g}", low, high, remark)
    out.print(shown)
    shown = table("What can be identified", out)
    for name in ("part of the model", "verdict", "why"):
        shown.add_column(name)
    for name in ("from, Hz", "to, Hz", "coherence"):
        shown.add_column(name, justify="right")
    for part in info.parts:
        own = [a for a in info.answers if a.part is part.part]
        if not own:
            why = part.cause.value if part.cause else ""
            shown.add_row(part.part.value, part.verdict.value, why, "", "", "")
        for a in own:
            low, high = (f"{f:.2g}" for f in a.usable_hz) if a.usable_hz else ("", "")
            best = "" if a.coherence is None else f"{a.coherence:.2f}"
            why = a.cause.value if a.cause else ""
            name = part.part.value if len(own) == 1 else f"{a.output} from {a.input}"
            shown.add_row(name, a.verdict.value, why, low, high, best)
    out.print(shown)
    for k in info.kinematics:
        out.print(
            f"{k.angle} is {k.scale:.3f} of what the rates integrate to, {1e3 * k.lag_s:.0f} ms "
            f"later; {100.0 * k.unexplained:.1f} % of its power is something else"
        )
    for v in info.vibration:
        peaks = ", ".join(f"{f:.1f}" for f in v.peaks_hz)
        lines = f", lines at {peaks} Hz" if peaks else ""
        unit = SIGNALS[v.name].unit
        out.print(f"{v.name}: {v.rms:.3g} {unit} rms from 10 to {v.upto_hz:.0f} Hz{lines}")


def draw_info(info: LogInfo, path: Path) -> None:
    """Inputs, rates, coherence of the answers, spectra of the rates."""
    signals = info.log.signals
    with picture(path, 4, 1, (8.0, 10.0)) as (figure, axes):
        moves, rates, coherence, spectra = axes[:, 0]
        for colour, i in zip(_COLOURS, info.inputs, strict=False):
            s = signals[i.name]
            moves.plot(s.time_s, s.value, color=colour, linewidth=0.7, label=i.name)
        for colour, name in zip(_COLOURS, ("p", "q", "r"), strict=False):
            if name not in signals:
                continue
            s = signals[name]
            rates.plot(s.time_s, s.value, color=colour, linewidth=0.5, label=name)
            grid = on_grid([s])
            x = grid.columns[name]
            if x.size >= 64:
                hertz, power = filters.welch(x, 1.0 / grid.dt_s, nperseg=min(x.size, 2048))
                spectra.loglog(hertz[1:], np.sqrt(power[1:]), color=colour, label=name)
        if info.response is not None:
            hertz = info.response.omega_radps / (2.0 * np.pi)
            main = [a for a in info.answers if a.input in info.columns and a.output in info.outputs]
            for colour, a in zip((*_COLOURS, GREY, GREY), main, strict=False):
                k, m = info.outputs.index(a.output), info.columns.index(a.input)
                style = "-" if colour != GREY else ":"
                label = f"{a.output} from {a.input}: {a.verdict.value}"
                part = info.response.partial_coherence[:, k, m]
                coherence.semilogx(hertz, part, style, color=colour, label=label)
            coherence.axhline(LEAST_COHERENCE, color=GREY, linewidth=0.8)
        labels = ("inputs", "rates, rad/s", "partial coherence", "rad/s over root Hz")
        for ax, label in zip(axes[:, 0], labels, strict=True):
            ax.set_ylabel(label)
            if ax.get_legend_handles_labels()[0]:
                ax.legend(loc="upper right", fontsize="small")
        coherence.set_ylim(0.0, 1.05)
        for ax in (moves, rates):
            ax.set_xlabel("time, s")
        for ax in (coherence, spectra):
            ax.set_xlabel("frequency, Hz")
        figure.suptitle(f"{Path(info.log.path).name}: {info.log.format}")
