# SPDX-License-Identifier: Apache-2.0
"""Pictures of a design: singular values, margins, attitude steps."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from heli_flight.report.plot_style import BLUE, GREEN, GREY, ORANGE, RED, picture
from heli_flight.studies.design.make import Design
from heli_inner_hinf.analysis import singular_values
from heli_inner_hinf.loops import TICK_S, Loop, flown_loop
from heli_inner_hinf.margins import mu_bounds
from heli_inner_hinf.weights import OUTPUTS
from heli_math.linear_systems import held

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


def _frequencies(loop: Loop) -> np.ndarray:
    return np.geomspace(0.1, 0.999 * np.pi / loop.dt if loop.dt else 500.0, 300)


def draw_singular_values(design: Design, path: Path) -> None:
    """Wind -> h and wind -> actuators over frequency, with gamma and gamma*."""
    synthesis = design.attitude.synthesis
    with picture(path, 1, 2, (7.2, 3.2), sharex=True) as (_, axes):
        for loop, (colour, style) in zip(design.loops, _LOOKS, strict=True):
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
            for loop, (colour, style) in zip(design.loops, _LOOKS, strict=True):
                omega = _frequencies(loop)
                alpha = disk_margins(loop, where, omega)
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


def disk_margins(loop: Loop, where: str, omega: np.ndarray) -> np.ndarray:
    """Disk margin (m,) at each frequency, in all channels at once; the smallest is the loop's."""
    L = loop.at_input(omega) if where == "input" else loop.at_output(omega)
    eye = np.eye(L.shape[1])
    return 1.0 / mu_bounds(np.linalg.inv(eye + L) - 0.5 * eye)


def draw_steps(design: Design, path: Path) -> None:
    """Steps of roll, pitch and heading: angles above, actuators below."""
    time_s = np.arange(round(STEP_LENGTH_S / TICK_S)) * TICK_S
    names = ("roll", "pitch", "heading")
    with picture(path, 2, 3, (7.6, 4.2), sharex=True) as (_, axes):
        for i, (name, size) in enumerate(zip(names, STEPS_DEG, strict=True)):
            r = np.zeros(3)
            r[i] = np.radians(size)
            ideal = np.degrees(state_feedback_step(design, r, time_s.size))
            flown, u = flown_step(design, r, time_s.size)
            top, bottom = axes[0, i], axes[1, i]
            top.plot(
                time_s, r[i] * 180.0 / np.pi + 0.0 * time_s, color=RED, lw=0.8, label="command"
            )
            colour, style = _LOOKS[0]
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


def state_feedback_step(design: Design, r: np.ndarray, n: int) -> np.ndarray:
    """Angles (n, 3), rad, from trim, of the continuous state feedback after a step r (3,)."""
    a = design.attitude
    gains = a.lqr if a.controller == "lqr" else a.synthesis
    Phi, Gamma = held(a.A + a.B @ gains.F, a.B @ gains.G, TICK_S)
    x, out = np.zeros(Phi.shape[0]), np.empty((n, 3))
    for i in range(n):
        out[i] = x[list(OUTPUTS)]
        x = Phi @ x + Gamma @ r
    return out


def flown_step(design: Design, r: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Angles (n, 3), rad, and commands (n, 3), from trim, of the loop as flown after a step r (3,).

    The command enters the law where a shift of the target does, so that the law with a shifted
    target tells how.
    """
    loop = design.loops[-1]
    law, plant = loop.controller, loop.plant
    shifting = replace(design.model, shift_rate=1.0)
    as_shift = flown_loop(
        shifting,
        design.observer.K,
        design.attitude.prediction_s,
        design.observer_input,
        design.actuation,
    ).controller
    size = as_shift.A.shape[0] - 3
    B_r = np.zeros((law.A.shape[0], 3))
    B_r[:size] = as_shift.A[:size, size:]
    B_r[size:] = TICK_S * design.model.shift_rate * np.eye(law.A.shape[0] - size, 3)
    D_r = as_shift.C[:, size:]
    x, w = np.zeros(plant.A.shape[0]), np.zeros(law.A.shape[0])
    angles, commands = np.empty((n, 3)), np.empty((n, 3))
    for i in range(n):
        y = plant.C[: loop.n_y] @ x
        u = law.C @ w + law.D @ y + D_r @ r
        angles[i], commands[i] = x[list(OUTPUTS)], u
        w = law.A @ w + law.B @ y + B_r @ r
        x = plant.A @ x + plant.B[:, :3] @ u
    return angles, commands
