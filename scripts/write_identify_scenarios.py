# SPDX-License-Identifier: Apache-2.0
"""Write the two scenarios of `heli identify`: which lines, how strong, for how long.

Usage: ./heli python scripts/write_identify_scenarios.py [FOLDER]

Why these numbers stands beside them here and in heli_flight's README.
"""

import sys
import textwrap
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from heli_core.signals import Multisine, design_multisine, zippered_lines
from heli_inner_hinf.design import flow_array

FOLDER = Path(__file__).resolve().parent.parent / "src/heli_flight/config/scenarios"
PERIOD_S = 20.0
START_S = 8.0
FADE_S = 2.0
SETTLING_S = 20.0
PERIODS = 8


@dataclass(frozen=True)
class Spec:
    """One experiment: bands (c, 2) Hz, lines, rms and spectrum of each channel."""

    name: str
    title: tuple[str, ...]
    bands_hz: tuple[tuple[float, float], ...]
    lines: tuple[int, ...]
    rms: tuple[float, ...]
    slopes: tuple[float, ...]
    corner_hz: float = 1.0

    def multisine(self) -> Multisine:
        """The excitation: amplitudes rise by `slope` above the corner."""
        lines, channel = zippered_lines(PERIOD_S, self.bands_hz, self.lines, odd=True)
        slope = np.array(self.slopes)[channel]
        weight = np.maximum(lines / self.corner_hz, 1.0) ** slope
        return design_multisine(PERIOD_S, lines, channel, weight, self.rms)


# Lines of odd multiples of 1/period: tail rotor, kink of the climb power and products of rates
# distort mostly evenly, and what is even falls between the lines. Cyclic up to 10.5 Hz, rising
# above 1 Hz, for the flapping and the servos: there the attitude hardly moves. Pedal from 0.25 to
# 6 Hz around the poles of the yaw-rate loop (8 and 13 rad/s). Stronger, and the tail rotor's odd
# distortion shows (0.03 rms of pedal: 2 % on B(r,d_ped)); weaker, and turbulence does.
ACTUATORS = Spec(
    name="identify_actuators",
    title=(
        "First experiment of `heli identify`: A, B, servos, delay, thrust map. All four actuators",
        "are excited at once, each by lines of its own, while PID and position loop hold the",
        "aircraft.",
    ),
    bands_hz=((0.15, 10.5), (0.15, 10.5), (0.25, 6.0), (0.15, 4.0)),
    lines=(16, 16, 20, 8),
    rms=(0.03, 0.03, 0.02, 0.012),
    slopes=(0.7, 0.7, 0.0, 0.0),
)
# Weak gusts: the tail rotor answers side wind more than in proportion (6 % at 0.7 m/s rms).
# w must swing through zero, where the power of climb has its kink.
GUSTS = Spec(
    name="identify_gusts",
    title=(
        "Second experiment of `heli identify`: E. A gust of three axes, each by lines of its own,",
        "is injected while PID and position loop hold the aircraft.",
    ),
    bands_hz=((0.05, 4.0), (0.05, 4.0), (0.05, 4.0)),
    lines=(12, 12, 12),
    rms=(0.4, 0.35, 0.5),
    slopes=(0.0, 0.0, 0.0),
)


def _excitation(spec: Spec, indent: int, key: str, digits: int) -> str:
    """The block of lines, amplitudes, phases and times."""
    multisine, pad = spec.multisine(), " " * indent
    lines = ", ".join(f"{f:.2f}" for f in multisine.frequency_hz)
    frequency = textwrap.fill(f"[{lines}]", 100, subsequent_indent=pad + " " * 15)
    duration = FADE_S + SETTLING_S + PERIODS * PERIOD_S + FADE_S
    amplitude = np.round(multisine.amplitude, digits)
    return "\n".join(
        f"{pad}{name}: {text}"
        for name, text in (
            ("frequency_hz", frequency),
            (key, flow_array(amplitude, indent + len(key) + 3)),
            ("phase_rad", flow_array(np.round(multisine.phase_rad, 4), indent + 12)),
            ("start_s", f"{START_S:.1f}"),
            ("duration_s", f"{duration:.1f}"),
            ("fade_s", f"{FADE_S:.1f}"),
        )
    )


def scenario(spec: Spec) -> str:
    """Text of a scenario file."""
    length = START_S + 2.0 * FADE_S + SETTLING_S + PERIODS * PERIOD_S + 2.0
    head = "".join(f"# {line}\n" for line in spec.title)
    crest = ", ".join(f"{value:.1f}" for value in spec.multisine().crest)
    rms = ", ".join(f"{value:g}" for value in spec.rms)
    text = f"""{head}# No mean wind; MIL-F-8785C turbulence of a calm day (1 m/s at 20 ft).
# In the hover test's (3 m/s) the slow part alone is a side wind of up to 1 m/s for the whole
# flight, on which E itself depends: E(r,v) by 28 % on seed 1.
# Written by scripts/write_identify_scenarios.py: period {PERIOD_S:g} s, {PERIODS} periods after
# {SETTLING_S:g} s of settling; rms {rms}; crest factors {crest}.
/**/scenario:
  ros__parameters:
    kind: hover
    duration_s: {length:.1f}
    start_pos_ned_m: [0.0, 0.0, -20.0]
    heading_deg: 0.0
    climb:
      start_s: 0.0
      end_s: 0.0
      speed_mps: 0.0
    # Only the hover before the excitation can be compared with the paper.
    score:
      windows_s: [3.0, {START_S:.1f}]
/**/plant:
  ros__parameters:
    wind:
      profile_altitude_m: [0.0]
      profile_speed_mps: [0.0]
      turbulence: true
      w20_mps: 1.0
"""
    if spec is GUSTS:
        text += "      sines:\n        frame: body\n"
        text += _excitation(spec, 8, "amplitude_mps", 4) + "\n"
    text += "/**/inner_loop:\n  ros__parameters:\n    # Needs no rotor state, and no model.\n"
    text += "    controller: pid\n"
    if spec is ACTUATORS:
        text += "    excitation:\n      attitude_limit_deg: 15.0\n"
        text += _excitation(spec, 6, "amplitude", 5) + "\n"
    return text


def main() -> int:
    """Write both files; 0 on success."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    for spec in (ACTUATORS, GUSTS):
        path = folder / f"{spec.name}.yaml"
        path.write_text(scenario(spec), encoding="utf-8")
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
