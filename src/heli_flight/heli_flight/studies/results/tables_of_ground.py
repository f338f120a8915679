# SPDX-License-Identifier: Apache-2.0
"""Tables of the aircraft on the ground: touch-downs, tipping over a skid, blind landings."""

from typing import Any

from heli_flight.studies.results.files import Results
from heli_flight.studies.results.grid import grid

_FELL = 89.0
"""A limit of the tilt, deg, that stands for none."""


def touch_downs(results: Results) -> str:
    """Touch-downs at three speeds on four kinds of ground, and standing in wind."""
    found = results["ground"]
    rows = [
        [
            row["ground"],
            f"{row['sink_mps']:.1f}",
            f"{row['bounce_mm']:.1f}",
            f"{row['skid_m']:.3f}",
            f"{row['tilt_deg']:.1f}",
            row["ended"],
        ]
        for row in found["landings"]
    ]
    head = [
        "ground",
        "sinking at, m/s",
        "bounce, mm",
        "skid, m",
        "largest roll or pitch, deg",
        "end",
    ]
    stands = "; ".join(
        f"{row['ground']}: creep {row['creep_mm']:.2f} mm, estimated level off by "
        f"{row['level_deg']:.2f} deg, heading {row['heading_deg']:.2f} deg, disc "
        f"{row['disc_deg']:.2f} deg"
        for row in found["stands"]
    )
    return (
        f"{grid(head, rows)}\n\nDefault aircraft, no law, still air, from hover's attitude; "
        "the collective goes to idle within 0.5 s from the first touch on. The bounce is the air "
        "below the lowest skid end after it, the skid the way along the ground in 5 s. Standing "
        f"10 s at idle in gusty wind of 5 m/s, seeds {found['seeds'][0]} to {found['seeds'][-1]}, "
        f"standalone receiver, the worst at the end: {stands} (disc: from 2 s on)."
    )


def rollover(results: Results) -> str:
    """Critical bank over a skid, and what lowering the collective saves."""
    found = results["ground"]
    rows = [
        [f"{row['lift']:.2f}", f"{row['statics_deg']:.1f}", f"{row['let_go_deg']:.1f}"]
        for row in found["critical"]
    ]
    stopped = [
        [
            f"{row['stick']:.2f}",
            "never" if row["limit_deg"] > _FELL else f"{row['limit_deg']:.0f} deg",
            f"{row['most_deg']:.1f}",
            row["ended"],
        ]
        for row in found["side_stick"]
    ]
    critical = grid(["lift over weight", "by statics, deg", "let go in the plant, deg"], rows)
    saved = grid(["stick to the right", "collective down at", "largest tilt, deg", "end"], stopped)
    return (
        f"{critical}\n\nBank at which nothing rights the aircraft on its right skid, at rest, "
        f"hover's cyclic and pedal, the skid caught.\n\n{saved}\n\nThe same at 0.90 of the weight "
        "from level ground, stick held; the collective is commanded down 40 ms after the tilt."
    )


def failsafes(results: Results) -> str:
    """Faults of sensors in the hover: off, lost, landed."""
    found = results["failsafes"]
    head = ["fault", "receiver", "lost", "off, m: median / worst", "goal, m", "down",
            "after, s", "at, m/s", "away, m"]  # fmt: skip
    rows = []
    for row in found["rows"]:
        most = row["max"]
        off = f"{row['median']['off_m']:.2f} / {most['off_m']:.2f}"
        goal = "" if row["goal_m"] is None else f"{row['goal_m']:g}"
        down = ["", "", "", ""]
        if row["lands"]:
            down = [str(row["down"])]
            for key, form in (("down_s", ".0f"), ("sink_mps", ".2f"), ("away_m", ".0f")):
                down.append("–" if most[key] is None else f"{most[key]:{form}}")
        rows.append([row["fault"], row["gps"], str(row["lost"]), off, goal, *down])
    return (
        f"{grid(head, rows)}\n\nOf {len(found['seeds'])} flights each (seeds {found['seeds'][0]} "
        f"to {found['seeds'][-1]}): hover at 10 m, world {found['world']}, default laws, the fault "
        f"from {found['begin_s']:g} s on, {found['end_s']:g} s long, {found['landed_s']:g} s where "
        f"it should land by itself. Off: largest distance from the same flight without the fault, "
        f"from truth, until the landing begins. Down: flights that came to stand by themselves; "
        f"time from the fault, speed of the touch-down and distance from the place: worst."
    )


def actuator_faults(results: Results) -> str:
    """Faults of actuators in the hover: who survives, how far off, how far turned."""
    found = results["actuator_faults"]
    channels = {"delta_lat": "lateral cyclic", "delta_lon": "longitudinal cyclic",
                "delta_ped": "pedal", "delta_col": "collective"}  # fmt: skip
    n = len(found["seeds"])
    rows = []
    for row in found["rows"]:
        lost_s, most = row["min"]["lost_s"], row["max"]
        rows.append([
            channels[row["what"]], row["fault"], row["gps"], f"{n - row['lost']} of {n}",
            "" if lost_s is None else f"{lost_s:.1f}",
            "–" if most["off_m"] is None else f"{row['median']['off_m']:.2f} / {most['off_m']:.2f}",
            "–" if most["turned_deg"] is None else f"{most['turned_deg']:.0f}",
        ])  # fmt: skip
    head = ["channel", "fault", "receiver", "survived", "first lost after, s",
            "off, m: median / worst", "turned, deg: worst"]  # fmt: skip
    return (
        f"{grid(head, rows)}\n\nSeeds {found['seeds'][0]} to {found['seeds'][-1]}, none of "
        "those on which soft flight was made: hover at 10 m, "
        f"world {found['world']}, default laws, "
        f"`failsafe.unfollowed_deg: [8.0, 5.5]`, the fault from {found['begin_s']:g} s on, flown "
        f"to {found['end_s']:g} s; where the attitude does not follow, "
        "it flies softly. Off and turned: largest distance and "
        "change of heading from the same flight without the fault, of those that survived, from "
        "truth: survived is not held. Behind a stuck pedal the yaw gyro goes on: the heading "
        "drifts and does not spin."
    )


def engine_out(results: Results) -> str:
    """Hovers whose engine stops: touch-down before and after the failsafe."""
    found = results["engine_out"]
    n = len(found["seeds"])

    def key(row: Any) -> tuple[Any, ...]:
        return row["world"], row["height_m"], row["navigation"]

    before = {key(row): row for row in found["rows"] if not row["failsafe"]}
    rows = []
    for row in found["rows"]:
        if not row["failsafe"]:
            continue
        most, was = row["max"], before[key(row)]
        rows.append([
            row["world"], f"{row['height_m']:g}", row["navigation"],
            f"{was['median']['down_mps']:.1f} / {was['max']['down_mps']:.1f}",
            f"{row['median']['down_mps']:.1f} / {most['down_mps']:.1f}",
            f"{was['kept']} to {row['kept']} of {n}", f"{row['stands']} of {n}",
            f"{most['tilt_deg']:.0f}", f"{most['along_mps']:.1f}", f"{most['after_s']:.1f}",
        ])  # fmt: skip
    head = ["world", "from, m", "navigation", "before, m/s: median / worst",
            "with it, m/s: median / worst", "gear kept", "stood", "tilt, deg", "along, m/s",
            "after, s"]  # fmt: skip
    return (
        f"{grid(head, rows)}\n\nOf {n} flights each (seeds {found['seeds'][0]} to "
        f"{found['seeds'][-1]}, none of those on which it was made): speed downwards at the "
        f"touch-down, the failsafe off and on. Gear kept: slower than {found['gear_mps']:g} m/s "
        f"and tilted less than {found['tilt_deg']:g} deg. Stood: the mode standing was reached. "
        "The last three: worst with the failsafe. Navigation truth: the loops get the true state. "
        f"At its speed the rotor holds {found['rotor_j']:.0f} J; the weight gives "
        f"{found['fall_j_per_m']:.0f} J per metre of height."
    )


def blind_landing(results: Results) -> str:
    """Landings so long after the last fix, world by world and receiver by receiver."""
    found = results["blind_landing"]

    def cell(value: Any, form: str) -> str:
        return "–" if value is None else f"{value:{form}}"

    head = [
        "world, receiver",
        "landing after, s",
        "stands",
        "position lost",
        "touch-down, m/s",
        "sideways then, m/s",
        "drift, m",
        "skid, m",
        "tilt from the touch-down on, deg",
        "step of the set-point, deg",
        "of the collective",
    ]
    rows = []
    for row in found["rows"]:
        most, median = row["max"], row["median"]
        rows.append(
            [
                f"{row['world']}, {row['gps']}",
                f"{row['wait_s']:.0f}",
                str(row["stands"]),
                str(row["position_lost"]),
                cell(most["sink_mps"], ".2f"),
                f"{cell(median['sideways_mps'], '.1f')} / {cell(most['sideways_mps'], '.1f')}",
                f"{cell(median['drift_m'], '.0f')} / {cell(most['drift_m'], '.0f')}",
                cell(most["skid_m"], ".1f"),
                cell(most["tilt_deg"], ".1f"),
                cell(most["attitude_deg"], ".2f"),
                cell(most["collective"], ".4f"),
            ]
        )
    return (
        f"{grid(head, rows)}\n\nHover at 10 m, the last fix after "
        f"{found['last_fix_s']:.0f} s, the landing commanded so long after it; truth, "
        f"{results.seeds('blind_landing')}. Stands, position lost (in the air): of "
        f"{len(found['seeds'])} flights; largest, sideways and drift since the last fix: median / "
        "largest; sideways: half a second before it stands; step: of the first command after the "
        "position was lost. Simulated, the scenario's wind, turbulence on, level ground."
    )
