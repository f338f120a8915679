# SPDX-License-Identifier: Apache-2.0
"""What stands behind the paper's figures: wind, actuators, estimates, design, timeline."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_dynamics_sim.wind import log_law
from heli_flight.loop.scoring import SETTLED_S, drift_at_engagement
from heli_flight.report.bands import FAILSAFE, FAULT, MODE, bands_of
from heli_flight.report.chart import Band, Chart, Panel, Trace, largest, level, limits
from heli_flight.report.data import LEVELS, Report
from heli_flight.report.design import Design
from heli_math.paper_metrics import heading_frame
from heli_math.rotations import rotation_between
from heli_math.rows import ACTUATOR, REFERENCE

_ACTUATORS = ("lateral", "longitudinal", "pedal", "collective")
_ACTUATOR_ROLES = ("nav", "truth", "green", "rival")
_LEVEL_ROLES = ("good", "warn", "bad", "muted")
_AXES = ("north", "east", "down")
_LEAST_SHARE = 0.004
_LOOP_ROLES = ("muted", "green", "nav")


def flight_charts(report: Report) -> list[Chart]:
    """Charts over flight time: wind, actuators, estimates against truth."""
    if not len(report.record):
        return []
    charts = [_wind(report)] if report.has_wind else []
    charts += [_actuators(report)]
    if report.kind != "attitude":
        charts.append(_attitude(report))
    if report.has_truth:
        charts += [
            _position_estimate(report),
            _velocity_estimate(report),
            _attitude_estimate(report),
        ]
    return [*charts, _rotor(report)]


def _mean_wind_mps(height_m: NDArray[np.float64], plant: Mapping[str, Any]) -> NDArray[np.float64]:
    """Steady wind at heights, by the profile of the plant's parameters."""
    if plant["wind.profile"] == "log":
        w20_mps, z0_m = plant["wind.w20_mps"], plant["wind.roughness_m"]
        return np.array([log_law(h, w20_mps, z0_m) for h in height_m])
    heights, speeds = plant["wind.profile_altitude_m"], plant["wind.profile_speed_mps"]
    return np.interp(height_m, heights, speeds)


def _wind(report: Report) -> Chart:
    r, plant = report.record, report.settings.nodes["plant"]
    ahead, right, down = heading_frame(r.wind_ned_mps, r.reference[:, REFERENCE.psi]).T
    height = -r.truth_pos_ned_m[:, 2] if report.has_truth else -r.nav_pos_ned_m[:, 2]
    mean = _mean_wind_mps(height, plant)
    t = r.time_s
    return Chart(
        "wind",
        "Wind",
        "Velocity of the air at the aircraft, blowing towards: its horizontal speed beside the "
        "mean of the profile at the flown height, and its parts in the heading frame.",
        [
            Panel(
                "speed, m/s",
                [
                    Trace(t, np.hypot(ahead, right), "wind at the aircraft", "nav"),
                    Trace(t, mean, "mean at this height", "reference", "dash"),
                ],
            ),
            Panel(
                "part, m/s",
                [
                    Trace(t, ahead, "forward", "truth"),
                    Trace(t, right, "to the right", "green"),
                    Trace(t, down, "down", "purple"),
                ],
            ),
        ],
        "flight",
        spans=report.spans,
    )


def _actuators(report: Report) -> Chart:
    r = report.record
    limit = float(report.settings.nodes["inner_loop"]["actuator_limit"])
    traces = [
        Trace(r.time_s, r.u[:, i], name, _ACTUATOR_ROLES[i]) for i, name in enumerate(_ACTUATORS)
    ]
    used = largest(r.u)
    bound = limits(r.time_s, limit, f"limit: ±{limit:g}")
    return Chart(
        "actuators",
        "Actuators",
        "Commands to the servos, normalised to (-1, 1): the whole range with its limits, and "
        f"enlarged. Largest: {used:.2f}, that is {100.0 * used / limit:.0f} % of the limit.",
        [
            Panel("command", [*traces, bound], y_range=(-1.05, 1.05), note="whole range"),
            Panel(
                "command", traces[ACTUATOR.attitude], note="enlarged: lateral, longitudinal, pedal"
            ),
            Panel("command", [traces[ACTUATOR.col]], note="enlarged: collective"),
        ],
        "flight",
        spans=report.spans,
    )


def _attitude(report: Report) -> Chart:
    r = report.record
    command = np.degrees(np.unwrap(r.setpoint, axis=0))
    panels = []
    for axis, name in enumerate(("roll", "pitch", "heading")):
        traces = []
        for source in reversed(report.sources()):
            label = "navigation record" if source == "navigation" else "ground truth"
            role = "nav" if source == "navigation" else "truth"
            angle = np.degrees(np.unwrap(np.radians(report.euler_deg(source)[:, axis])))
            traces.append(Trace(r.time_s, angle, label, role))
        traces.append(Trace(r.time_s, command[:, axis], "command", "reference", "dash", width=1.0))
        panels.append(Panel(f"{name}, °", traces))
    return Chart(
        "attitude",
        "Attitude",
        "Roll, pitch and heading beside what the outer loop commands.",
        panels,
        "flight",
        spans=report.spans,
    )


def _estimate(
    report: Report,
    error: np.ndarray,
    sigma: np.ndarray | None,
    what: str,
    unit: str,
    axes: tuple[str, ...] = _AXES,
):
    """Panels of the axes of estimate minus truth inside 3 sigma; and a sentence."""
    t, panels = report.record.time_s, []
    share = _share_inside(error, sigma)
    for axis, name in enumerate(axes):
        traces = []
        if share is not None and sigma is not None:
            edge = 3.0 * sigma[:, axis]
            traces.append(Trace(t, edge, "3 σ of the filter", "nav", "band", y2=-edge))
        traces.append(Trace(t, error[:, axis], "estimate - truth", "truth"))
        panels.append(Panel(f"{name}, {unit}", traces))
    if share is None:
        return panels, f"{what} error. The covariance was not recorded."
    return panels, f"{what}: estimate minus truth; {share:.1f} % of it inside 3 σ."


def _position_estimate(report: Report) -> Chart:
    """Position's error inside its sigma, and which sigma that is."""
    r = report.record
    error = r.nav_pos_ned_m - r.truth_pos_ned_m
    panels, caption = _estimate(report, error, r.nav_sigma_pos_m, "Position", "m")
    unknown = report.settings.nodes["observer"]["ekf.initial.drift_at_alignment_fraction"]
    if unknown == 1.0:
        caption += " σ is of the position in the world: the receiver's drift is in it."
    else:
        caption += (
            " σ is of the position as it counts from the alignment: what the receiver drifts from "
            "there on is in σ; what it was off by then is in the error, not in σ: no instrument on "
            "board can tell it."
        )
        offset = drift_at_engagement(r)
        if offset is not None:
            less = f"less its value at {SETTLED_S:g} s"
            panels = [
                replace(panel, traces=[*panel.traces, Trace(r.time_s, e - o, less, "green", "dot")])
                for panel, e, o in zip(panels, error.T, offset, strict=True)
            ]
            share = _share_inside(error - offset, r.nav_sigma_pos_m)
            if share is not None:
                caption += f" The error {less}: {share:.1f} % of it inside 3 σ."
    return Chart("estimate_position", "Position estimate", caption, panels, "estimate")


def _share_inside(error: np.ndarray, sigma: np.ndarray | None) -> float | None:
    """How much of an error, %, is inside 3 sigma; None where sigma was not recorded."""
    if sigma is None or not bool((sigma > 0.0).any()):
        return None
    inside = np.abs(error) <= 3.0 * sigma
    compared = inside[np.isfinite(error) & np.isfinite(sigma)]
    return 100.0 * float(compared.mean()) if compared.size else 0.0


def _velocity_estimate(report: Report) -> Chart:
    r = report.record
    error = r.nav_vel_ned_mps - r.truth_vel_ned_mps
    panels, caption = _estimate(report, error, r.nav_sigma_vel_mps, "Velocity", "m/s")
    return Chart("estimate_velocity", "Velocity estimate", caption, panels, "estimate")


def _attitude_estimate(report: Report) -> Chart:
    r = report.record
    error = np.degrees(rotation_between(r.truth_q_nb, r.nav_q_nb))
    sigma = None if r.nav_sigma_att_rad is None else np.degrees(r.nav_sigma_att_rad)
    axes = tuple(f"about {axis}" for axis in _AXES)
    panels, caption = _estimate(report, error, sigma, "Attitude", "°", axes)
    caption += " About down is the heading, which hover shows to the magnetometer only."
    return Chart("estimate_attitude", "Attitude estimate", caption, panels, "estimate")


def _rotor(report: Report) -> Chart:
    r, panels = report.record, []
    names = ("a_s, mrad", "b_s, mrad", "d_int, mrad")
    for axis, y_label in enumerate(names):
        traces = []
        if report.has_rotor_truth:
            traces.append(Trace(r.time_s, 1e3 * r.truth_rotor[:, axis], "ground truth", "truth"))
        traces.append(Trace(r.time_s, 1e3 * r.nav_rotor[:, axis], "estimate, eq. (19)", "nav"))
        panels.append(Panel(y_label, traces))
    words = ""
    if report.has_rotor_truth:
        error = 1e3 * (r.nav_rotor - r.truth_rotor)
        error = error[np.isfinite(error).all(axis=1)]
        if len(error):
            rms = np.sqrt(np.mean(error**2, axis=0))
            words = f" Error, rms: {rms[0]:.2g}, {rms[1]:.2g}, {rms[2]:.2g} mrad."
    return Chart(
        "rotor",
        "Flapping and yaw gyro",
        "Longitudinal and lateral flapping a_s, b_s and the yaw gyro's integrator d_int: what the "
        f"reduced-order observer makes of them.{words}",
        panels,
        "estimate",
    )


def design_charts(design: Design) -> list[Chart]:
    """Singular values from wind to the controlled output and to the actuators."""
    outputs, inputs = [], []
    roles = _LOOP_ROLES[-len(design.loops) :]
    for i, (loop, role) in enumerate(zip(design.loops, roles, strict=True)):
        w = design.omega[i]
        outputs.append(Trace(w, design.wind_to_h[i][:, 0], loop.name, role, width=1.8))
        inputs.append(Trace(w, design.wind_to_u[i][:, 0], loop.name, role, width=1.8))
    flown = design.loops[-1]
    for values in design.wind_to_h[-1].T[1:]:
        outputs.append(Trace(design.omega[-1], values, "", "nav", "dot", width=1.0))
    for values in design.wind_to_u[-1].T[1:]:
        inputs.append(Trace(design.omega[-1], values, "", "nav", "dot", width=1.0))
    w = design.omega[0]
    bound, highest, said = design.bound, float(np.max(design.wind_to_h[-1])), ""
    if bound is not None:
        outputs += [
            level(w, bound.gamma, f"γ = {bound.gamma:.4f}"),
            level(w, bound.gamma_star, f"γ* = {bound.gamma_star:.4f}", "reference", "dot"),
        ]
        highest, said = max(bound.gamma, highest), f" γ is {bound.of}."
    if np.isfinite(flown.norm):
        highest = max(highest, flown.norm)
    top = 2.0 * highest
    return [
        Chart(
            "singular_values",
            "Singular values",
            "From wind (m/s) to the controlled output h, eq. (11), and to the actuators: the "
            f"largest of each loop, and the smaller ones of the loop as flown (dotted).{said}",
            [
                Panel("σ(wind → h)", outputs, log_y=True, y_range=(1e-3 * top, top)),
                Panel("σ(wind → u)", inputs, log_y=True, y_range=(1e-6, 1e-1)),
            ],
            "design",
            x_label="frequency, rad/s",
            time=False,
            log_x=True,
        )
    ]


def timeline_charts(report: Report) -> list[Chart]:
    """Lanes: phase of the flight, actuators at their limit, and each node's health."""
    if not len(report.record):
        return []
    lanes: list[str] = []
    traces: list[Trace] = []
    named: set[str] = set()

    def add(lane: str, stretches: list[tuple[float, float]], label: str, role: str) -> None:
        if lane not in lanes:
            lanes.append(lane)
        if not stretches:
            return
        x = np.array([v for a, b in stretches for v in (a, b, np.nan)])
        y = np.full(x.size, float(lanes.index(lane)))
        traces.append(Trace(x, y, "" if label in named else label, role, "bar", width=13.0))
        named.add(label)

    climbing = np.abs(report.record.reference[:, REFERENCE.down_vel]) > 1e-6
    add("reference", _stretches(report, ~climbing), "hover", "nav")
    add("reference", _stretches(report, climbing), "climb", "muted")
    bands = report.bands or bands_of(report.record, report.settings, (), report.events)
    for band in bands:
        if band.kind == MODE:
            add("mode", [(band.start_s, band.end_s)], band.name, band.role)
    add("scored", report.spans, "scored", "purple")
    for band in bands:
        if band.kind == FAULT:
            add(f"fault: {band.of}", [_wide(report, band)], "a fault that was flown", band.role)
    for band in bands:
        if band.kind == FAILSAFE:
            add("failsafe", [_wide(report, band)], f"failsafe: {band.name}", band.role)
    limit = float(report.settings.nodes["inner_loop"]["actuator_limit"])
    at_limit = (np.abs(report.record.u) >= limit - 1e-9).any(axis=1)
    add("at limit", _stretches(report, at_limit), "an actuator at its limit", "bad")
    for node, stretches in _health(report).items():
        for value, (label, role) in enumerate(zip(LEVELS, _LEVEL_ROLES, strict=True)):
            add(node, stretches.get(value, []), label, role)
    said = "Health of each node, from /diagnostics." if report.events else (
        "One process has no nodes, so there is no health of nodes to show."
        if report.how.startswith("one process")
        else "No /diagnostics were recorded."
    )  # fmt: skip
    bottom, height = len(lanes) - 0.4, 0.2 * len(lanes)
    return [
        Chart(
            "timeline",
            "Timeline",
            f"Phase of the flight, scored stretches, actuators at their limit. {said}",
            [Panel("", traces, height, y_range=(bottom, -0.6), y_ticks=lanes)],
            "timeline",
            bands=(),
        )
    ]


def _wide(report: Report, band: Band) -> tuple[float, float]:
    """A band's start and end, s; a moment is drawn wide enough to be seen."""
    end_s = float(report.record.time_s[-1])
    return band.start_s, max(band.end_s, band.start_s + _LEAST_SHARE * end_s)


def _stretches(report: Report, mask: np.ndarray) -> list[tuple[float, float]]:
    """Start and end, s, of the runs of True in mask (N,)."""
    t = report.record.time_s
    edges = np.diff(np.concatenate([[0], mask.astype(int), [0]]))
    starts, ends = np.nonzero(edges == 1)[0], np.nonzero(edges == -1)[0] - 1
    return [(float(t[a]), float(t[b])) for a, b in zip(starts, ends, strict=True)]


def _health(report: Report) -> dict[str, dict[int, list[tuple[float, float]]]]:
    """Stretches of each level of each node."""
    end = float(report.record.time_s[-1])
    lanes: dict[str, dict[int, list[tuple[float, float]]]] = {}
    for node in dict.fromkeys(event.node for event in report.events):
        own = [event for event in report.events if event.node == node]
        after = [*(event.time_s for event in own[1:]), end]
        for event, until in zip(own, after, strict=True):
            # A fault of a moment is drawn wide enough to be seen; the table below has its length.
            shown = until if event.level == 0 else max(until, event.time_s + _LEAST_SHARE * end)
            stretch = (max(0.0, event.time_s), max(0.0, shown))
            lanes.setdefault(node, {}).setdefault(event.level, []).append(stretch)
    return lanes
