# SPDX-License-Identifier: Apache-2.0
"""What `heli design` prints: trim, certificate, margins of the three loops, gains; or all of it as
JSON.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from heli_core.central_controller import GammaInfimum
from heli_core.rows import ACTUATOR_NAMES, ATTITUDE, INPUT_NAMES, MEASURED, NINE, STATE_NAMES
from heli_core.ticks import TICK_S, ticks_in
from heli_flight.position_axes import NAMES
from heli_flight.report.figures import BLUE, GREEN, GREY, ORANGE, RED, picture
from heli_flight.terminal import table
from heli_inner_hinf.controller_state import CONTROLLERS, STATE_FEEDBACK
from heli_inner_hinf.loops import COMMANDS, POSITIONS, ChannelMargin, Loop
from heli_inner_hinf.mu import DiskMargin, disk_margins
from heli_inner_hinf.output_feedback import OutputSynthesis
from heli_inner_hinf.synthesis import GammaStar
from heli_inner_hinf.tuning import singular_values
from heli_outer_pd.analysis import AxisReport
from heli_studies.design.make import LONGEST_DELAY_S, FinishedDesign, norms_on_the_way

# -------------------------------------------------------------------------------------------------
# Report.
# -------------------------------------------------------------------------------------------------

_DISK, _CHANNEL = ("", ", gain", ", phase"), (", gain", ", phase", ", delay")


def print_design(design: FinishedDesign, out: Console) -> None:
    """Everything a control engineer asks first, in tables."""
    s = design.attitude.synthesis
    out.print(f"{design.basis.source}: {design.basis.outer['mass']:g} kg")
    x, u = design.attitude.x_trim, design.basis.u_trim
    commands = ", ".join(f"{n} {v:.4f}" for n, v in zip(ACTUATOR_NAMES, u, strict=True))
    out.print(
        f"trim of hover in still air: phi {np.degrees(x[NINE.phi]):.3f} deg, "
        f"theta {np.degrees(x[NINE.theta]):.3f} deg, {commands}; largest "
        f"residual {design.basis.residual:.1e}"
    )
    out.print(f"modes of the aircraft without control, rad/s: {_modes(design)}")
    output = design.attitude.output
    if design.attitude.bound is None:
        out.print(
            f"controller {design.attitude.controller} has no bound on its norm; of state feedback "
            "with these weights (controller: hinf), which is not flown:"
        )
    if output is None:
        star = s.gamma_star
        out.print(
            f"gamma* = {star.value:.10g} in [{star.lower:.10g}, {star.upper:.10g}] "
            f"({star.mechanism.value}), gamma = {s.gamma:.8g} = {s.gamma / star.value:.4f} gamma*, "
            f"norm wind -> h = {s.norm:.6g} at {s.norm_frequency:.3g} rad/s"
        )
        out.print(_certificate(design, out))
    else:
        out.print(_of_output(output))
    out.print(said_of_the_flown_norm(design))
    out.print(OF_THE_DISTURBANCE)
    out.print(_margins(design, out))
    survived = design.further_delay_s
    more = "more than " if survived >= LONGEST_DELAY_S else ""
    out.print(
        f"as flown: servos {design.actuation.servo_radps:g} rad/s, transport delay "
        f"{1e3 * design.actuation.delay_s:g} ms, 100 Hz; survives {more}{1e3 * survived:.0f} ms of "
        "further delay in all channels at once"
    )
    if output is None:
        out.print(_gains("F transposed, u = F x + G r", s.F, INPUT_NAMES, STATE_NAMES, out))
    names = [STATE_NAMES[i] for i in MEASURED]
    poles = ", ".join(f"{p:g}" for p in design.observer.poles)
    out.print(
        _gains(
            f"observer's K transposed, poles {poles} rad/s",
            design.observer.K,
            ("a_s", "b_s", "d_int"),
            names,
            out,
        )
    )
    if design.outer and design.outer_together:
        out.print(_outer(design, out))
        lags = design.values["outer_loop"]["disturbance.attitude_lag_s"]
        out.print(
            f"phi_ref, theta_ref and collective broken together: disk margin "
            f"{design.outer_together.alpha:.2f} at {design.outer_together.frequency:.1f} rad/s; "
            f"around the attitude loop of {design.attitude.controller} as flown, lag of pitch "
            f"{lags[0]:.2f} s, of roll {lags[1]:.2f} s"
        )


def _modes(design: FinishedDesign) -> str:
    """Poles of the linear model in words, fastest first; oscillations with their damping."""
    with np.errstate(invalid="ignore"):  # a pole at 0 has no damping
        import control

        frequencies, dampings, poles = control.damp(design.basis.system, doprint=False)
    words = []
    for i in np.argsort(-frequencies):
        pole, damping = poles[i], dampings[i]
        if pole.imag > 0.0:
            words.append(f"{pole.real:.3g} +- {pole.imag:.3g}i (damping {damping:.3f})")
        elif pole.imag == 0.0:
            words.append(f"{pole.real:.3g}" if abs(pole) > 1e-9 else "0")
    return ", ".join(words)


OF_THE_DISTURBANCE = (
    "the wind in these norms acts by E of eq. (10), on fuselage, fins and tail rotor: it has "
    "neither the load at the rotor's hub nor flap-back, so a smaller norm is no prediction of "
    "smaller errors in flight"
)
"""What a norm from the wind does not say."""


def _of_output(output: OutputSynthesis) -> str:
    """Certificate of output feedback in a sentence."""
    star, K = output.gamma_star, output.controller
    return (
        f"output feedback of order {output.law.A.shape[0]}: gamma* = {star.value:.6g} in "
        f"[{star.lower:.6g}, {star.value:.6g}] ({star.mechanism.value}), gamma = "
        f"{output.gamma:.6g} = {output.gamma / star.value:.4f} gamma*, "
        f"norm (wind, load, noise) -> (h, integrals) = {output.norm:.6g} at "
        f"{output.norm_frequency:.3g} rad/s, rho(X Y) / gamma^2 = {K.radius:.4g}, "
        f"largest residual of both Riccati equations {K.residual:.1e}"
    )


def said_of_the_flown_norm(design: FinishedDesign) -> str:
    """What the certificate is worth for the loop as flown; where it is exceeded, by what."""
    flown, gamma = design.between_samples, design.attitude.synthesis.gamma
    sentence = (
        f"as flown, between its samples too: norm wind -> h = {flown.upper:.6g} at "
        f"{flown.frequency_radps:.3g} rad/s (bounds {flown.upper - flown.lower:.1e} apart)"
    )
    if CONTROLLERS[design.attitude.controller] != STATE_FEEDBACK:
        return sentence
    if flown.upper < gamma:
        return f"{sentence}, below gamma = {gamma:.6g}: what is certified holds as flown"
    steps = ", ".join(
        f"{name} {_norm(value)}"
        for name, value in norms_on_the_way(
            design.model,
            design.observer.K,
            design.attitude.prediction_s,
            design.observer_input,
            design.actuation,
        )
    )
    return f"{sentence}, NOT below gamma = {gamma:.6g}, which is proved for state feedback: {steps}"


def _norm(value: float) -> str:
    return f"{value:.6g}" if np.isfinite(value) else "unstable"


def _outer(design: FinishedDesign, out: Console) -> Table:
    return _beside(
        "Position loop, gain and phase margin of either sign; rms in the hover test's turbulence "
        "with RTK, and the LQG lower bound with ideal actuators",
        (
            "crossover",
            "gain margin",
            "phase margin",
            "disk margin",
            "position",
            "at least",
            "speed",
            "at least ",
        ),
        dict(zip(NAMES, map(_axis, design.outer), strict=True)),
        out,
    )


def _axis(report: AxisReport) -> list[str]:
    if not report.stable:
        return ["unstable", *([""] * 7)]
    return [
        f"{report.crossover_radps:.2f} rad/s",
        f"{report.gain_margin_db:.1f} dB",
        f"{report.phase_margin_deg:.0f} deg",
        f"{report.disk_margin:.2f}",
        f"{report.position_rms_m:.3f} m",
        f"{report.position_limit_m:.3f} m",
        f"{report.speed_rms_mps:.3f} m/s",
        f"{report.speed_limit_mps:.3f} m/s",
    ]


def _beside(
    title: str, names: Sequence[str], columns: Mapping[str, Sequence[str]], out: Console
) -> Table:
    """A table of a column for each of few things, a row for each of what is told of them."""
    rows = table(title, out)
    rows.add_column("")
    for head in columns:
        rows.add_column(head, justify="right")
    for name, *cells in zip(names, *columns.values(), strict=True):
        rows.add_row(name, *cells)
    return rows


def _certificate(design: FinishedDesign, out: Console) -> Table:
    rows = table("Certificate: eq. (16) has a stabilising P >= 0 at this gamma", out)
    for name in ("condition", "number", "bound", ""):
        rows.add_column(name, justify="left" if name in ("condition", "") else "right")
    for condition in design.attitude.synthesis.certificate.conditions:
        rows.add_row(
            condition.name,
            f"{condition.value:.4g}",
            f"{condition.bound:.4g}",
            "holds" if condition.holds else "FAILS",
        )
    return rows


def _margins(design: FinishedDesign, out: Console) -> Table:
    names = ["norm wind -> h"]
    names += [f"{name}{part}" for name in ("disk, input", "disk, output") for part in _DISK]
    names += [f"{name}{part}" for name in INPUT_NAMES for part in _CHANNEL]
    columns = {
        report.name: [
            f"{report.norm:.4f}",
            *_disk(report.disk_input),
            *_disk(report.disk_output),
            *(word for margin in report.channels_input for word in _channel(margin)),
        ]
        for report in design.reports
    }
    title = "Margins (disk: all channels at once; d_lat to d_ped: one, others closed)"
    return _beside(title, names, columns, out)


def _disk(margin: DiskMargin) -> tuple[str, str, str]:
    return f"{margin.alpha:.2f}", f"{margin.gain_db:.1f} dB", f"{margin.phase_deg:.0f} deg"


def _channel(margin: ChannelMargin) -> tuple[str, str, str]:
    delay = "inf" if np.isinf(margin.delay_s) else f"{1e3 * margin.delay_s:.0f} ms"
    return f"{margin.gain_up_db:.1f} dB", f"{margin.phase_deg:.0f} deg", delay


def _gains(
    title: str, matrix: np.ndarray, names: Sequence[str], columns: Sequence[str], out: Console
) -> Table:
    """A gain matrix, transposed: it has few rows."""
    cells = {
        name: [f"{value + 0.0:.4f}" for value in row]
        for name, row in zip(names, matrix, strict=True)
    }
    return _beside(title, columns, cells, out)


def as_dict(design: FinishedDesign) -> dict[str, Any]:
    """For --json; infinities become None, as JSON has none. gamma and norm: of what flies."""
    s, bound = design.attitude.synthesis, design.attitude.bound
    return {
        "aircraft": design.basis.plant.get("aircraft_file", ""),
        "trim": {"x": design.attitude.x_trim.tolist(), "u": design.basis.u_trim.tolist(),
                 "residual": _finite(design.basis.residual)},
        "controller": design.attitude.controller,
        "gamma": bound and bound.gamma,
        "gamma_star": bound and _infimum(bound.gamma_star),
        "norm": bound and bound.norm,
        "norm_frequency_radps": bound and bound.norm_frequency,
        "state_feedback": {
            "gamma": s.gamma,
            "gamma_star": _infimum(s.gamma_star),
            "norm": s.norm,
            "norm_frequency_radps": s.norm_frequency,
            "certificate": [
                {"condition": c.name, "value": _finite(c.value), "bound": _finite(c.bound),
                 "holds": bool(c.holds)}
                for c in s.certificate.conditions
            ],
            "F": s.F.tolist(),
            "G": s.G.tolist(),
        },
        "between_samples": design.between_samples._asdict(),
        "loops": [
            {
                "name": report.name,
                "norm": _finite(report.norm),
                "disk_input": report.disk_input.alpha,
                "disk_output": report.disk_output.alpha,
                "channels_input": {
                    name: {"gain_db": _finite(m.gain_up_db), "phase_deg": _finite(m.phase_deg),
                           "gain_down_db": _finite(m.gain_down_db),
                           "delay_s": _finite(m.delay_s)}
                    for name, m in zip(INPUT_NAMES, report.channels_input, strict=True)
                },
            }
            for report in design.reports
        ],
        "further_delay_s": design.further_delay_s,
        "position_loop_together": design.outer_together and design.outer_together.alpha,
        "position_loop": {
            name: {key: _finite(value) for key, value in asdict(report).items()}
            for name, report in zip(NAMES, design.outer, strict=False)
        },
        "output": _as_dict_of_output(design.attitude.output),
        "K": design.observer.K.tolist(),
        "observer_poles_radps": list(design.observer.poles),
        "pid": {axis.axis: {"K_P": axis.K_P, "K_I": axis.K_I, "K_D": axis.K_D}
                for axis in design.pid},
    }  # fmt: skip


def _infimum(star: GammaStar | GammaInfimum) -> dict[str, Any]:
    return {"value": star.value, "lower": star.lower, "mechanism": star.mechanism.value}


def _as_dict_of_output(output: OutputSynthesis | None) -> dict[str, Any] | None:
    if output is None:
        return None
    return {
        "order": output.law.A.shape[0],
        "radius": output.controller.radius,
        "residual": output.controller.residual,
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


# -------------------------------------------------------------------------------------------------
# Pictures of a design: singular values, margins, attitude steps.
# -------------------------------------------------------------------------------------------------

WANTED_DISK = 0.5
STEPS_DEG = (5.0, 5.0, 20.0)
STEP_LENGTH_S = 6.0
_LOOKS = ((GREY, ":"), (ORANGE, "--"), (BLUE, "-"))
_INPUTS = (
    (r"$\delta_{lat}$", BLUE, "-"),
    (r"$\delta_{lon}$", RED, "--"),
    (r"$\delta_{ped}$", GREEN, ":"),
)


def draw_all(design: FinishedDesign, folder: Path) -> list[Path]:
    """Write the three pictures; their paths."""
    paths = [folder / f"{name}.png" for name in ("singular_values", "margins", "step")]
    for draw, path in zip((draw_singular_values, draw_margins, draw_steps), paths, strict=True):
        draw(design, path)
    return paths


def _looks(design: FinishedDesign) -> list[tuple[Loop, tuple[str, str]]]:
    """The loops, the one as flown last, with colour and line."""
    return list(zip(design.loops, _LOOKS[-len(design.loops) :], strict=True))


def _frequencies(loop: Loop) -> np.ndarray:
    return np.geomspace(0.1, 0.999 * np.pi / loop.dt if loop.dt else 500.0, 300)


def draw_singular_values(design: FinishedDesign, path: Path) -> None:
    """Wind -> h and wind -> actuators over frequency; of hinf, whose norm it is, with its bound.

    What `output.gamma` bounds is the norm of more inputs to more outputs: no level of this picture.
    """
    bounded = design.attitude.controller == "hinf"
    with picture(path, 1, 2, (7.2, 3.2), sharex=True) as (_, axes):
        for loop, (colour, style) in _looks(design):
            omega = _frequencies(loop)
            for axis, sigma in zip(axes[0], singular_values(loop, omega), strict=True):
                axis.loglog(omega, sigma[:, 0], color=colour, ls=style, label=loop.name)
                if loop is design.loops[-1]:
                    axis.loglog(omega, sigma[:, 1:], color=colour, lw=0.6, alpha=0.5)
        words, highest = "", max(report.norm for report in design.reports)
        if bounded:
            synthesis = design.attitude.synthesis
            gamma, star = synthesis.gamma, synthesis.gamma_star.value
            axes[0, 0].axhline(gamma, color=RED, lw=0.9)
            axes[0, 0].axhline(star, color=RED, lw=0.9, ls="--")
            words = rf"bounds: $\gamma$ = {gamma:.4f} (solid), $\gamma^*$ = {star:.4f} (dashed)"
            highest = max(highest, gamma)
        axes[0, 0].set_title(f"wind → h\n{words}", fontsize=9)
        axes[0, 1].set_title("wind → actuators\n", fontsize=9)
        axes[0, 0].set_ylabel("singular value (s/m)")
        axes[0, 0].set_ylim(highest * 1e-3, highest * 3.0)
        axes[0, 1].set_ylim(1e-5, None)
        for axis in axes[0]:
            axis.set_xlabel("frequency (rad/s)")
        axes[0, 0].legend(loc="lower left", title="largest of each loop", title_fontsize=8)


def draw_margins(design: FinishedDesign, path: Path) -> None:
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


def draw_steps(design: FinishedDesign, path: Path) -> None:
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
        # One scale of roll and pitch, for both overshoots: shared axes would keep the first's.
        ends = [end for axis in axes[0, :2] for end in axis.get_ylim()]
        for axis in axes[0, :2]:
            axis.set_ylim(min(ends), max(ends))
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
    import control

    simulated = control.forced_response(closed, timepts=time_s, inputs=inputs)
    return simulated.states[list(ATTITUDE)].T, simulated.outputs.T
