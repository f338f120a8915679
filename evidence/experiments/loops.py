# SPDX-License-Identifier: Apache-2.0
"""Print of the controller `hinf` gamma*, norms, margins, observer gains, PID, as JSON.

Usage: ./heli python -m evidence.experiments.loops

The loops are those of `heli design`, and besides: as flown without prediction, by LQR, with an
offset-free target, and by the controller of default. Nothing is flown.
"""

import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from evidence.files import Results
from evidence.registry import MARGIN, produces, table
from evidence.tables import grid
from heli_core.rows import INPUT_NAMES
from heli_flight.settings import resolve
from heli_flight.worlds import LAWS
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import Model, flown_loop, further_delay_s
from heli_inner_hinf.synthesis import gamma_star
from heli_inner_hinf.tuning import LoopReport, analyse, choose_observer_gain, model_of
from heli_studies.design.make import LONGEST_DELAY_S, FinishedDesign, make_design

PUBLISHED = Path(__file__).resolve().parents[2] / ("tests/verification/data/nus_linear_model.yaml")
OFFSET_FREE_RADPS = (0.5, 1.0)
# Rotor pole and gyro pole, rad/s, of the observers that are shown.
SHOWN_POLES = ((-3.0, -5.0), (-10.0, -5.0), (-20.0, -5.0), (-40.0, -5.0))


def finite(value: float) -> float | None:
    """The value, None for infinity: JSON has none."""
    return float(value) if np.isfinite(value) else None


def loop_row(name: str, report: LoopReport, delay_s: float | None = None) -> dict[str, Any]:
    """Norm and margins of a loop; `delay_s`: what it survives on top of its own."""
    return {
        "loop": name,
        "norm": finite(report.norm),
        "disk_input": report.disk_input.alpha,
        "disk_output": report.disk_output.alpha,
        "channels": {
            channel: {"gain_db": finite(m.gain_up_db), "phase_deg": finite(m.phase_deg)}
            for channel, m in zip(INPUT_NAMES, report.channels_input, strict=True)
        },
        "further_delay_s": delay_s,
    }


def loops(design: FinishedDesign, parameters: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The three loops of the design, then variants of the loop as flown."""
    K, feed, actuation = design.observer.K, design.observer_input, design.actuation

    def flown(name: str, model: Model, prediction_s: float) -> dict[str, Any]:
        loop = flown_loop(model, K, prediction_s, feed, actuation)
        delay = further_delay_s(loop, model, actuation, LONGEST_DELAY_S)
        return loop_row(name, analyse(loop), delay)

    def model_with(**changes: Any) -> Model:
        return model_of(AttitudeConfig.from_parameters({**parameters, **changes}))

    ahead, model = design.attitude.prediction_s, design.model
    rows = [loop_row(report.name, report) for report in design.reports[:2]]
    return [
        *rows,
        flown("as flown", model, ahead),
        flown("as flown, no prediction", model, 0.0),
        flown("as flown, LQR", model_with(controller="lqr"), ahead),
        *(
            flown(
                f"as flown, offset-free {rate:g} rad/s", model_with(offset_free_radps=rate), ahead
            )
            for rate in OFFSET_FREE_RADPS
        ),
    ]


def default_loop() -> dict[str, Any]:
    """What flies if no controllers are named."""
    design = make_design()
    name = f"as flown, {design.attitude.controller} (default)"
    return loop_row(name, design.reports[-1], design.further_delay_s)


def observers(design: FinishedDesign) -> list[dict[str, Any]]:
    """Pole sets of the observer and their price, the loop as flown; the chosen one is marked."""
    plain = replace(design.model, shift_rate=0.0)
    best, tried = choose_observer_gain(
        plain, design.attitude.prediction_s, design.actuation, design.observer_input
    )
    return [
        {
            "rotor_radps": c.poles[0],
            "gyro_radps": c.poles[2],
            "disk_input": c.disk_input,
            "disk_output": c.disk_output,
            "norm": finite(c.norm),
            "noise_gain": finite(c.noise_gain),
            "further_delay_s": c.further_delay_s,
            "chosen": c.poles == best.poles,
        }
        for c in tried
        if (c.poles[0], c.poles[2]) in SHOWN_POLES or c.poles == best.poles
    ]


def published_gamma_star(design: FinishedDesign) -> float:
    """gamma* of the published A, B, E with the packaged weights."""
    model = yaml.safe_load(PUBLISHED.read_text(encoding="utf-8"))
    A, B, E = (np.array(model[name], float) for name in ("A", "B", "E"))
    return gamma_star(A, B, E, design.attitude.C, design.attitude.D).value


def main() -> int:
    """Print everything; 0."""
    design = make_design([LAWS.file("hinf")])
    star = design.attitude.synthesis.gamma_star
    content = {
        "gamma": design.attitude.gamma,
        "gamma_star": star.value,
        "gamma_over_gamma_star": design.attitude.gamma / star.value,
        "mechanism": star.mechanism.value,
        "frequency_radps": star.frequency,
        "published_gamma_star": published_gamma_star(design),
        "servo_radps": design.actuation.servo_radps,
        "servo_damping": design.actuation.servo_damping,
        "delay_s": design.actuation.delay_s,
        "prediction_s": design.attitude.prediction_s,
        "loops": [*loops(design, resolve(laws="hinf").nodes["inner_loop"]), default_loop()],
        "observers": observers(design),
        "pid": [
            {
                "axis": axis.axis,
                "crossover_radps": axis.crossover_radps,
                "phase_margin_deg": axis.phase_margin_deg,
                "peak_sensitivity": axis.peak,
            }
            for axis in design.pid
        ],
    }
    print(json.dumps(content))
    return 0


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "loops",
    "./heli python -m evidence.experiments.loops",
    "Norms and margins of the controller hinf, their observer and the PID; those of the default.",
    relative=MARGIN,
)


_CHANNELS = ("d_lat", "d_lon", "d_ped")


@table("loops")
def loops_table(results: Results) -> str:
    """Norms and margins of the controller `hinf`, and of the default as flown."""
    record = results["loops"]
    head = ["loop", "norm wind -> h", "disk margin, input", "disk margin, output"]
    head += [f"gain / phase margin {channel}" for channel in _CHANNELS]
    rows = [
        [
            row["loop"],
            f"{row['norm']:.4f}",
            f"{row['disk_input']:.2f}",
            f"{row['disk_output']:.2f}",
            *(_margin(row["channels"][channel]) for channel in _CHANNELS),
            "" if row["further_delay_s"] is None else f"{1e3 * row['further_delay_s']:.0f} ms",
        ]
        for row in record["loops"]
    ]
    return (
        f"{grid([*head, 'further delay survived'], rows)}\n\n"
        f"gamma = {record['gamma']:g} = {record['gamma_over_gamma_star']:.2f} gamma*, "
        f"gamma* = {record['gamma_star']:.6f} ({record['mechanism']}, at "
        f"{record['frequency_radps']:.1f} rad/s; of the published A, B, E: "
        f"{record['published_gamma_star']:.6f}). As flown: servos of {record['servo_radps']:g} "
        f"rad/s "
        f"(damping {record['servo_damping']:g}), {1e3 * record['delay_s']:g} ms of delay, 100 Hz, "
        f"prediction {1e3 * record['prediction_s']:g} ms."
    )


def _margin(channel: Mapping[str, Any]) -> str:
    gain = "inf" if channel["gain_db"] is None else f"{channel['gain_db']:.1f} dB"
    return f"{gain} / {channel['phase_deg']:.0f} deg"


@table("observer_gains")
def observer_gains(results: Results) -> str:
    """What the observer's poles buy and cost."""
    rows = [
        [
            f"{row['rotor_radps']:g} / {row['gyro_radps']:g}" + " (chosen)" * row["chosen"],
            f"{row['disk_input']:.2f} / {row['disk_output']:.2f}",
            f"{row['norm']:.4f}",
            f"{row['noise_gain']:.3f}",
        ]
        for row in results["loops"]["observers"]
    ]
    head = ["poles, rotor / gyro, rad/s", "disk margin, input / output", "norm wind -> h"]
    return grid([*head, "actuator rms per gyro rms, 1/(rad/s)"], rows)


@table("pid_axes")
def pid_axes(results: Results) -> str:
    """The PID's loops_table."""
    rows = [
        [
            axis["axis"],
            f"{axis['crossover_radps']:.1f} rad/s",
            f"{axis['phase_margin_deg']:.0f} deg",
            f"{axis['peak_sensitivity']:.2f}",
        ]
        for axis in results["loops"]["pid"]
    ]
    return grid(["PID, axis", "crossover", "phase margin", "max abs(S)"], rows)


if __name__ == "__main__":
    sys.exit(main())
