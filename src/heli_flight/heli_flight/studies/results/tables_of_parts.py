# SPDX-License-Identifier: Apache-2.0
"""Tables of parts: linear loops, navigation, linear model, recorder, set-up."""

from collections.abc import Mapping
from typing import Any

from heli_flight.studies.results.files import Results
from heli_flight.studies.results.grid import grid, three, world

_CHANNELS = ("d_lat", "d_lon", "d_ped")


def loops(results: Results) -> str:
    """Norms and margins of the laws `hinf`, and of the default as flown."""
    found = results["loops"]
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
        for row in found["loops"]
    ]
    return (
        f"{grid([*head, 'further delay survived'], rows)}\n\n"
        f"gamma = {found['gamma']:g} = {found['gamma_over_gamma_star']:.2f} gamma*, "
        f"gamma* = {found['gamma_star']:.6f} ({found['mechanism']}, at "
        f"{found['frequency_radps']:.1f} rad/s; of the published A, B, E: "
        f"{found['published_gamma_star']:.6f}). As flown: servos of {found['servo_radps']:g} rad/s "
        f"(damping {found['servo_damping']:g}), {1e3 * found['delay_s']:g} ms of delay, 100 Hz, "
        f"prediction {1e3 * found['prediction_s']:g} ms."
    )


def _margin(channel: Mapping[str, Any]) -> str:
    gain = "inf" if channel["gain_db"] is None else f"{channel['gain_db']:.1f} dB"
    return f"{gain} / {channel['phase_deg']:.0f} deg"


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


def pid_axes(results: Results) -> str:
    """The PID's loops."""
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


def fusion(results: Results) -> str:
    """How good the navigation is."""
    found = results["fusion"]
    flown = {"Hover test": [row["conditions"] for row in found["aircraft"]]}
    return (
        f"{fusion_tables(found)}\n\nRms over {results.seeds('fusion')}. First table: hover test, "
        f"loop closed, from 5 s on. The others: synthetic flights. {world(flown)}"
    )


def fusion_tables(found: Mapping[str, Any]) -> str:
    """The three tables of what scripts/fusion_table.py has found."""
    aircraft = [
        [
            row["gps"],
            three(row["attitude_ned_deg"], 2),
            three(row["velocity_ned_mps"], 3),
            three(row["position_ned_m"], 3),
            three(row["receiver_ned_m"], 3),
        ]
        for row in found["aircraft"]
    ]
    consistency = [
        [
            row["gps"],
            row["name"],
            " to ".join(dict.fromkeys(f"{value:.3f}" for value in row["over_degrees"])),
            " to ".join(f"{bound:.3f}" for bound in row["bounds"]),
            str(row["degrees"]),
        ]
        for row in found["consistency"]
    ]
    latency = [
        [row["gps"], row["latency"], f"{row['position_m']:.3f}", f"{row['velocity_mps']:.3f}"]
        for row in found["latency"]
    ]
    axes = "north, east, down"
    errors = [f"attitude, deg: {axes}", f"velocity, m/s: {axes}", f"position, m: {axes}"]
    normalised = f"over its degrees of freedom (NEES: at {found['times']} times)"
    return "\n\n".join(
        (
            grid(["GPS", *errors, "the receiver's own error, m"], aircraft),
            grid(
                ["GPS", "normalised error squared", normalised, "bounds 0.999", "degrees"],
                consistency,
            ),
            grid(["GPS", "latency 0.15 s", "horizontal position, m", "velocity, m/s"], latency),
        )
    )


def navigation(results: Results) -> str:
    """The navigation's errors in each world, and their causes."""
    return (
        f"{navigation_tables(results['navigation'])}\n\nRms over {results.seeds('navigation')}, "
        "hover test, loop closed; north, east, down. Start: from 0.5 to 5 s; all others from 5 s "
        "on. Stated: the filter's own standard deviation. Second table: the world `honest`, one "
        "cause taken out of the simulation at a time, the filter told the same."
    )


def navigation_tables(found: Mapping[str, Any]) -> str:
    """The two tables of what scripts/navigation_table.py has found."""
    parts_of = {"start": "start_deg", "all": "deg", "stays": "stays_deg", "moves": "moves_deg"}
    keys = [*parts_of.values(), "stated_deg"]
    worlds = [
        [
            f"{row['world']}, {row['gps']}",
            *(three(row[f"attitude_{key}"], 2) for key in keys),
            f"{three(row['velocity_mps'], 3)} ({three(row['velocity_stated_mps'], 3)})",
            three([1e3 * value for value in row["rotor_rad"]], 1),
            three([1e3 * value for value in row["rotor_moves_rad"]], 1),
        ]
        for row in found["worlds"]
    ]
    head = ["world, GPS", *(f"attitude, deg: {name}" for name in (*parts_of, "stated"))]
    head += ["velocity, m/s (stated)", "a_s, b_s, d_int, mrad", "of it what moves"]
    causes = [
        [
            f"{row['gps']}: {row['cause']}",
            *(three(row[f"attitude_{key}"], 2) for key in parts_of.values()),
            three(row["velocity_mps"], 3),
        ]
        for row in found["parts"]
    ]
    parts = ["honest, GPS: simulated", *(f"attitude, deg: {name}" for name in parts_of)]
    return f"{grid(head, worlds)}\n\n{grid([*parts, 'velocity, m/s'], causes)}"


def deviations(results: Results) -> str:
    """Entries of A, B, E that are not the published ones."""
    rows = results["deviations"]["rows"]
    explained = [
        [row["entry"], f"{row['published']:.4f}", f"{row['ours']:.4f}", row["remark"]]
        for row in rows
        if row["remark"]
    ]
    return (
        f"{grid(['entry', 'published', 'ours', 'why'], explained)}\n\nThe other "
        f"{len(rows) - len(explained)} of {len(rows)} entries that are not zero or pure kinematics "
        "are within 0.6 % of the published ones or half a unit of their last digit."
    )


def cpu_types(results: Results) -> str:
    """How far the same flights of two processors are apart."""
    found = results["cpu_types"]
    rows = []
    for row in found["rows"]:
        if row["why_not"]:
            rows.append([row["name"], row["against"], row["why_not"], "", "", "", ""])
            continue
        sizes = (row["position_m"], row["position_end_m"], row["attitude_rad"])
        rows.append(
            [
                row["name"],
                row["against"],
                f"{row['differing']} of {row['numbers']}",
                f"{row['same_ticks'] * found['tick_s']:g} s",
                *(f"{size:.0e}" if size else "0" for size in sizes),
            ]
        )
    head = ["changed", "compared with", "recorded numbers that differ", "none differs for"]
    head += ["position, m, largest", "at the end", "attitude, rad"]
    return (
        f"{grid(head, rows)}\n\nHover and attitude test, both receivers, 60 s, one process, "
        f"{results.seeds('cpu_types')} (emulated: the first); {found['libc']}."
    )


def recorder(results: Results) -> str:
    """Losses and processor time of the recorder, sizes of bags."""
    found = results["recorder"]
    rates = [
        [
            f"{row['rate_hz']:.0f}",
            str(row["sent"]),
            str(row["lost"]),
            f"{100.0 * row['recorder_cpu']:.0f} %",
        ]
        for row in found["rates"]
    ]
    bags = [
        [
            row["storage"] + ("" if row["compression"] == "none" else f", {row['compression']}"),
            f"{row['flight_s']} s",
            str(row["messages"]),
            f"{row['size_mb']:.1f} MB",
        ]
        for row in found["bags"]
    ]
    made = results.read["recorder"]
    return (
        f"{grid(['messages/s, 10 topics, MCAP', 'sent', 'lost', 'of a core'], rates)}\n\n"
        f"{grid(['bag of a flight', 'flight', 'messages', 'size'], bags)}\n\n"
        f"Sender and recorder on {made['processor']['cores']} cores, load {made['load']:g}."
    )


def setup(results: Results) -> str:
    """What the first call of a command costs."""
    found, made, size = results["setup"], results.read["setup"], results["setup_size"]
    split = ", ".join(f"{name} {seconds} s" for name, seconds in found["split_s"].items())
    return (
        "From a fresh clone with empty caches `./hover_test.sh` ends after "
        f"{found['total_s']:.0f} s on {made['processor']['cores']} cores (load {made['load']:g}): "
        f"{found['setup_s']} s of "
        f"set-up ({split}), {found['start_up_s']:.0f} s until all nodes are up, "
        f"{found['flown_s']:g} s flown in {found['flight_s']:.1f} s, then the report. "
        f"It downloads {size['download_mb']} MB; the environment takes {size['disk_mb']} MB of "
        "disk. "
        f"The test tools add {size['test_mb']} MB and {size['test_disk_mb']} MB."
    )


def dead_reckoning(results: Results) -> str:
    """What dead reckoning is off by after the last fix: causes, bound with drag, flown."""
    found = results["dead_reckoning"]
    rows = []
    for row in found["rows"]:
        causes = [f"{row['sigma_m'][key]:.2f}" for key in ("velocity", "tilt", "gyro", "noise")]
        flown = row["flown"]
        rows.append([
            row["gps"], f"{row['fixes_s']:.0f}", f"{row['silent_s']:.0f}", *causes,
            f"{row['sigma_m']['all']:.2f}", f"{row['with_drag_m']:.2f}",
            f"{row['expected_worst_m']:.1f}",
            "" if flown is None else f"{flown['rms_m']:.2f} / {flown['worst_m']:.1f}",
        ])  # fmt: skip
    head = ["receiver", "fixes for, s", "then none for, s", "velocity", "tilt, accelerometers",
            "gyro bias", "noise", "all", "drag read, at least", "worst of all, expected",
            "flown: rms / worst"]  # fmt: skip
    gust, n = found["rows"][-1], len(found["seeds"])
    return (
        f"{grid(head, rows)}\n\nMetres since the last fix; one standard deviation northward, from "
        f"the filter's covariance at the last fix (hover, world {found['world']}, seed "
        f"{found['seeds'][0]}) and its noise since. All: with the links between the causes. Worst "
        f"expected: the mean of the largest of {n} distances in the plane, "
        f"{found['worst_of_sigma']:.2f} times all. Drag read: speed through the air without error, "
        "mean wind and gust at the last fix known, gusts then a first-order process of "
        f"{gust['gust_mps']:.2f} m/s and {gust['gust_s']:.0f} s, which the flights' wind has. "
        f"Flown: error of the navigation against truth, seeds {found['seeds'][0]} to "
        f"{found['seeds'][-1]}, rms of an axis / largest distance."
    )
