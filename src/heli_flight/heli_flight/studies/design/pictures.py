# SPDX-License-Identifier: Apache-2.0
"""Pictures of a design: singular values, margins, attitude steps."""

from pathlib import Path

import control
import numpy as np

from heli_flight.report.plot_style import BLUE, GREEN, GREY, ORANGE, RED, picture
from heli_flight.studies.design.make import Design
from heli_inner_hinf.analysis import singular_values
from heli_inner_hinf.disk_margin import disk_margins
from heli_inner_hinf.loops import COMMANDS, POSITIONS, Loop
from heli_math.state_names import ATTITUDE
from heli_math.ticks import TICK_S, ticks_in

WANTED_DISK = 0.5
STEPS_DEG = (5.0, 5.0, 20.0)
STEP_LENGTH_S = 6.0
_LOOKS = ((GREY, ":"), (ORANGE, "--"), (BLUE, "-"))
_INPUTS = (
    (r"$\delta_{lat}$", BLUE, "-"),
    (r"$\delta_{lon}$", RED, "--"),
    (r"$\delta_{ped}$", GREEN, ":"),
)


def draw_all(design: Design, folder: Path) -> list[Path]:
    """Write the three pictures; their paths."""
    paths = [folder / f"{name}.png" for name in ("singular_values", "margins", "step")]
    for draw, path in zip((draw_singular_values, draw_margins, draw_steps), paths, strict=True):
        draw(design, path)
    return paths


def _looks(design: Design) -> list[tuple[Loop, tuple[str, str]]]:
    """The loops, the one as flown last, with colour and line."""
    return list(zip(design.loops, _LOOKS[-len(design.loops) :], strict=True))


def _frequencies(loop: Loop) -> np.ndarray:
    return np.geomspace(0.1, 0.999 * np.pi / loop.dt if loop.dt else 500.0, 300)


def draw_singular_values(design: Design, path: Path) -> None:
    """Wind -> h and wind -> actuators over frequency, with gamma and gamma*."""
    synthesis = design.attitude.output or design.attitude.synthesis
    with picture(path, 1, 2, (7.2, 3.2), sharex=True) as (_, axes):
        for loop, (colour, style) in _looks(design):
            omega = _frequencies(loop)
            for axis, sigma in zip(axes[0], singular_values(loop, omega), strict=True):
                axis.loglog(omega, sigma[:, 0], color=colour, ls=style, label=loop.name)
                if loop is design.loops[-1]:
                    axis.loglog(omega, sigma[:, 1:], color=colour, lw=0.6, alpha=0.5)
        axes[0, 0].axhline(synthesis.gamma, color=RED, lw=0.9)
        star = synthesis.gamma_star.value
        axes[0, 0].axhline(star, color=RED, lw=0.9, ls="--")
        bounds = (
            rf"bounds: $\gamma$ = {synthesis.gamma:.4f} (solid), $\gamma^*$ = {star:.4f} (dashed)"
        )
        axes[0, 0].set_title(f"wind → h\n{bounds}", fontsize=9)
        axes[0, 1].set_title("wind → actuators\n", fontsize=9)
        axes[0, 0].set_ylabel("singular value (s/m)")
        axes[0, 0].set_ylim(star * 1e-3, star * 4.0)
        axes[0, 1].set_ylim(1e-5, None)
        for axis in axes[0]:
            axis.set_xlabel("frequency (rad/s)")
        axes[0, 0].legend(loc="lower left", title="largest of each loop", title_fontsize=8)


def draw_margins(design: Design, path: Path) -> None:
    """Disk margin of all channels at once over frequency, at the plant's input and output."""
    with picture(path, 1, 2, (7.2, 3.2), sharex=True, sharey=True) as (_, axes):
        for axis, where in zip(axes[0], ("input", "output"), strict=True):
            for loop, (colour, style) in _looks(design):
                omega = _frequencies(loop)
                L = loop.at_input(omega) if where == "input" else loop.at_output(omega)
                alpha = disk_margins(L)
                axis.loglog(omega, alpha, color=colour, ls=style, label=loop.name)
                if loop is design.loops[-1]:
                    worst = int(np.argmin(alpha))
                    axis.plot(omega[worst], alpha[worst], "o", color=colour, ms=4)
                    axis.annotate(
                        f"{alpha[worst]:.2f}",
                        (omega[worst], alpha[worst]),
                        xytext=(6, -10),
                        textcoords="offset points",
                        color=colour,
                        fontsize=9,
                    )
            axis.axhline(WANTED_DISK, color=RED, lw=0.9)
            axis.text(0.11, WANTED_DISK * 0.97, "wanted: 0.5", color=RED, va="top", fontsize=8)
            axis.set_title(f"at the plant {where}")
            axis.set_xlabel("frequency (rad/s)")
        axes[0, 0].set_ylim(0.3, 3.0)
        ticks = (0.3, 0.5, 1.0, 2.0, 3.0)
        axes[0, 0].set_yticks(ticks, [f"{t:g}" for t in ticks])
        axes[0, 0].minorticks_off()
        axes[0, 0].set_ylabel(r"disk margin $\alpha$, all channels at once")
        axes[0, 0].legend(loc=(0.62, 0.36))


def draw_steps(design: Design, path: Path) -> None:
    """Steps of roll, pitch and heading: angles above, actuators below."""
    time_s = np.arange(ticks_in(STEP_LENGTH_S)) * TICK_S
    names = ("roll", "pitch", "heading")
    with picture(path, 2, 3, (7.6, 4.2), sharex=True) as (_, axes):
        for i, (name, size) in enumerate(zip(names, STEPS_DEG, strict=True)):
            r = np.zeros(3)
            r[i] = np.radians(size)
            ideal = np.degrees(step(design.loops[0], r, time_s)[0])
            flown, u = step(design.loops[-1], r, time_s)
            top, bottom = axes[0, i], axes[1, i]
            top.plot(
                time_s, r[i] * 180.0 / np.pi + 0.0 * time_s, color=RED, lw=0.8, label="command"
            )
            colour, style = _LOOKS[0]
            if len(design.loops) > 1:
                top.plot(time_s, ideal[:, i], color=colour, ls=style, label="state feedback")
            top.plot(time_s, np.degrees(flown)[:, i], color=BLUE, label="as flown")
            others = np.delete(np.degrees(flown), i, axis=1)
            top.plot(time_s, others, color=BLUE, lw=0.6, alpha=0.6)
            top.set_title(f"{name} step, {size:g}°")
            for channel, (label, c, ls) in enumerate(_INPUTS):
                bottom.plot(time_s, u[:, channel], color=c, ls=ls, label=label)
            bottom.set_xlabel("time (s)")
            bottom.set_xlim(0.0, STEP_LENGTH_S)
        axes[0, 0].set_ylabel("angle (deg)")
        axes[1, 0].set_ylabel("actuators from trim (−1…1)")
        axes[0, 1].sharey(axes[0, 0])
        axes[0, 0].legend(loc="center right")
        axes[1, 0].legend(loc="upper right", ncols=3, columnspacing=0.8, handlelength=1.2)


def step(loop: Loop, size_rad: np.ndarray, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles (n, 3), rad, and actuators' positions (n, 3) from trim after a step of the command.

    Parameters
    ----------
    loop : Loop
    size_rad : (3,) array
        Of the commanded phi, theta, psi.
    time_s : (n,) array
        On the loop's ticks if it is sampled.
    """
    closed = loop.closed[list(POSITIONS), list(COMMANDS)]
    inputs = np.repeat(size_rad[:, None], time_s.size, axis=1)
    found = control.forced_response(closed, timepts=time_s, inputs=inputs)
    return found.states[list(ATTITUDE)].T, found.outputs.T
