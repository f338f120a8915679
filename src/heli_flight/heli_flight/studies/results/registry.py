# SPDX-License-Identifier: Apache-2.0
"""Which command makes which result file."""

from collections.abc import Iterable

from heli_flight.studies.results.producer import (
    FIT,
    MARGIN,
    NOT_COMPARED,
    TWENTY,
    Producer,
)
from heli_parameters.parameters import ParameterError

__all__ = ["PRODUCERS", "Producer", "chosen"]

_ATTITUDE = "./heli compare attitude --seeds 1..20 --ideal-navigation --json"
PRODUCERS = (
    Producer(
        "hover",
        "./heli campaign --scenario hover --world paper --seeds 1..20 --json",
        "The hover test with both receivers.",
        TWENTY,
    ),
    Producer(
        "attitude",
        "./heli campaign --scenario attitude --seeds 1..20 --json",
        "The attitude test with both receivers.",
        TWENTY,
    ),
    Producer(
        "worlds",
        "./heli compare worlds --seeds 1..20,2001..2020 --json",
        "The hover test in the worlds, with both receivers.",
        (*TWENTY, *range(2001, 2021)),
    ),
    Producer(
        "worlds_paper",
        "./heli compare worlds --laws paper --seeds 1..20,2001..2020 --json",
        "The hover test in the worlds under the paper's own laws.",
        (*TWENTY, *range(2001, 2021)),
    ),
    Producer(
        "paper_causes",
        "./heli python scripts/paper_causes.py --seeds 1..10",
        "What stands between the paper's laws and its figures, one cause at a time.",
        tuple(range(1, 11)),
        MARGIN,
    ),
    Producer(
        "paths",
        "./heli python scripts/paths_table.py --seeds 1..20",
        "How closely the scenarios along a path are flown, with both receivers.",
        TWENTY,
    ),
    Producer(
        "mte",
        "./heli python scripts/mte_table.py --seeds 1..20",
        "How well the scored manoeuvres are flown, with both receivers.",
        TWENTY,
    ),
    Producer(
        "response",
        "./heli python scripts/response_table.py --seeds 1..5",
        "Responses of the attitude loop to sweeps and steps, by law.",
        tuple(range(1, 6)),
        MARGIN,
    ),
    Producer(
        "w20",
        "./heli compare worlds --worlds honest --w20 2,4,6,8 --seeds 1..20 --json",
        "The hover test in the honest world over the wind at 20 ft.",
        TWENTY,
    ),
    Producer("laws", _ATTITUDE, "The laws in the attitude test.", TWENTY),
    Producer(
        "laws_gusts",
        f"{_ATTITUDE} --gusts",
        "The laws in the attitude test with gusts.",
        TWENTY,
    ),
    Producer(
        "laws_flap_back",
        f"{_ATTITUDE} --gusts --flap-back",
        "The same on a rotor that flaps back.",
        TWENTY,
    ),
    Producer(
        "laws_everywhere",
        "./heli compare laws --seeds 1..20,2001..2020 --n 60 --json",
        "Every file of laws in the worlds and on perturbed aircraft.",
        (*TWENTY, *range(2001, 2021)),
    ),
    Producer(
        "robustness",
        "./heli compare robustness --n 200 --json",
        "The nominal aircraft's laws on aircraft that differ from it.",
        tuple(range(1, 201)),
    ),
    Producer(
        "position_floor",
        "./heli python scripts/position_floor.py --seeds 1..8",
        "The hover beside the least that any linear position law leaves; nose into the wind; "
        "mass, thrust, servos, drag 30 % off.",
        tuple(range(1, 9)),
        MARGIN,
    ),
    Producer(
        "robust",
        "./heli python scripts/robust_table.py",
        "The proof of the packaged attitude law over the named set, other laws beside it.",
        relative=MARGIN,
        # How many pieces a proof takes, and how clear it is, hang on rounding.
        loose={"pieces": NOT_COMPARED, "largest_psi": NOT_COMPARED},
    ),
    Producer(
        "gamma",
        "./heli python scripts/gamma_table.py --seeds 1..10",
        "What gamma and the weights do to the state feedback and to its flights in gusts.",
        tuple(range(1, 11)),
    ),
    Producer(
        "takeoff",
        "./heli python scripts/takeoff_table.py --seeds 1..20",
        "The scenario takeoff_land in winds, on slopes, in two worlds, with both receivers.",
        TWENTY,
    ),
    Producer(
        "failsafes",
        "./heli python scripts/failsafe_table.py --seeds 1..10",
        "Hovers with faults of the sensors, with both receivers.",
        tuple(range(1, 11)),
        # As of a landing without a place to hold.
        MARGIN,
    ),
    Producer(
        "actuator_faults",
        "./heli python scripts/actuator_fault_table.py --seeds 1..10",
        "Hovers with faults of the actuators, with both receivers.",
        tuple(range(1, 11)),
        # An aircraft that is not held keeps no difference small.
        MARGIN,
    ),
    Producer(
        "links",
        "./heli python scripts/link_table.py --seeds 1..10",
        "Hovers with faults of the links between nodes, with both receivers.",
        tuple(range(1, 11)),
        # What is nearly lost keeps no difference small.
        MARGIN,
    ),
    Producer(
        "dead_reckoning",
        "./heli python scripts/dead_reckoning_table.py --seeds 1..10",
        "What dead reckoning is off by after the last fix, and of what that is made.",
        tuple(range(1, 11)),
    ),
    Producer(
        "blind_landing",
        "./heli python scripts/blind_landing_table.py --seeds 1..20",
        "Landings after the last fix, in two worlds with both receivers.",
        TWENTY,
        # Without a place to hold nothing keeps a difference small.
        MARGIN,
    ),
    Producer(
        "sequence",
        "./heli python scripts/sequence_table.py --seeds 1..20",
        "The scenario sequence in two worlds with both receivers: ground, changes of modes.",
        TWENTY,
    ),
    Producer(
        "rates",
        "./heli python scripts/rates_table.py --seeds 1..20",
        "The hover test at 100, 200 and 400 Hz with both receivers.",
        TWENTY,
    ),
    Producer(
        "into_wind",
        "./heli python scripts/into_wind_table.py --seeds 1..20",
        "The nose turned into winds from anywhere, in two worlds.",
        TWENTY,
    ),
    Producer(
        "airspeed",
        "./heli python scripts/airspeed_table.py --seeds 1..20",
        "The attitude loop from hover to 12 m/s, and the scenario forward_flight.",
        TWENTY,
        MARGIN,
    ),
    Producer(
        "identification",
        "./heli python scripts/identify_seeds.py --seeds 1..20",
        "The default aircraft identified from flight, then flown with what was found.",
        TWENTY,
        FIT,
    ),
    Producer(
        "identification_others",
        "./heli python scripts/identify_seeds.py --seeds 1 --aircraft xcell60.yaml,logo600.yaml",
        "Two other aircraft identified from flight, then flown with what was found.",
        (1,),
        FIT,
    ),
    Producer(
        "loops",
        "./heli python scripts/loop_table.py",
        "Norms and margins of the laws hinf, their observer and the PID; those of the default.",
        relative=MARGIN,
    ),
    Producer(
        "fusion",
        "./heli python scripts/fusion_table.py --seeds 1..20 --json",
        "Errors and consistency of the navigation.",
        TWENTY,
    ),
    Producer(
        "navigation",
        "./heli python scripts/navigation_table.py --seeds 1..20 --json",
        "Errors of the navigation in the worlds, and their causes.",
        TWENTY,
    ),
    Producer(
        "deviations",
        "./heli python scripts/deviation_table.py --json",
        "A, B, E of the linearised aircraft beside the published ones.",
    ),
    Producer(
        "term_effects",
        "./heli python scripts/term_effects.py",
        "What each term of the aircraft does to trim, A, B, E and the tilt of the disc.",
    ),
    Producer(
        "term_flights",
        "./heli python scripts/term_flights.py --seeds 1..20",
        "The hover test with terms of the rotor, and with eq. (7), unknown to the controllers.",
        TWENTY,
    ),
    Producer(
        "ground",
        "./heli python scripts/ground_table.py --seeds 1..20",
        "Touch-downs, standing in wind, tipping over a skid.",
        TWENTY,
        MARGIN,
    ),
    Producer(
        "cpu_types",
        "./heli python scripts/compare_cpu_types.py --seeds 1..5 --json",
        "The same flights as other processors fly them.",
        tuple(range(1, 6)),
        # What rounding makes of rounding: a number of each kind of processor.
        loose={
            key: NOT_COMPARED
            for key in (
                "differing",
                "same_ticks",
                "position_m",
                "position_end_m",
                "attitude_rad",
            )
        },
    ),
    Producer(
        "recorder",
        "./heli python scripts/recorder_table.py",
        "Losses and load of the recorder, sizes of bags.",
        loose={
            "rate_hz": NOT_COMPARED,
            "recorder_cpu": NOT_COMPARED,
            "messages": 0.05,
            "size_mb": 0.1,
        },
    ),
    Producer(
        "speed",
        "./heli python scripts/bench_plant.py --json",
        "Times of the plant and of the whole loop in one process.",
        loose={
            key: NOT_COMPARED
            for key in (
                "step_us",
                "tick_us",
                "noise_row_us",
                "loop_times_real_time",
                "first_compilation_s",
            )
        },
    ),
    Producer(
        "closed_loop",
        "./heli python benchmarks/closed_loop.py --json",
        "The loop in one process beside rotorpy's, and the parts of a flight.",
        loose={
            key: NOT_COMPARED
            for key in (
                "resolve_s",
                "build_s",
                "fly_s",
                "score_s",
                "times_real_time",
                "command_s",
                "command_with_report_s",
                "imports_s",
                "command_over_imports",
                "peer_times_real_time",
                "times_peer",
            )
        },
    ),
    Producer(
        "graph",
        "./heli python benchmarks/graph.py --json",
        "Speed of the node graph in lockstep beside a bare ring of rclpy nodes.",
        loose={key: NOT_COMPARED for key in ("rates", "ratios", "machine")},
    ),
    Producer(
        "respawn",
        "./heli python scripts/respawn_table.py --seeds 1..10",
        "Hovers in real time in which nodes are killed or paused, with --respawn.",
        tuple(range(1, 11)),
        loose={key: NOT_COMPARED for key in ("machine", "flights")},
    ),
    Producer(
        "latency",
        "./heli python benchmarks/latency.py --seconds 600 --json",
        "The node graph in real time for ten minutes beside a bare ring at its pace.",
        loose={key: NOT_COMPARED for key in ("ring", "graph", "ratios", "machine")},
    ),
    Producer(
        "latency_400",
        "./heli python benchmarks/latency.py --seconds 60 --rate 400 --json",
        "The node graph at 400 Hz in real time beside a bare ring at its pace.",
        loose={key: NOT_COMPARED for key in ("ring", "graph", "ratios", "machine")},
    ),
    Producer(
        "fuzz",
        "./heli python scripts/fuzz_counts.py --cases 10000",
        "Damaged messages and files: taken, refused in a sentence, failed.",
        (),
    ),
    Producer(
        "soak",
        "./heli python benchmarks/soak.py --json",
        "An hour of flight, twenty minutes in real time, a hundred starts, fifty Ctrl-C.",
        (1,),
        loose={key: NOT_COMPARED for key in ("lockstep", "realtime", "starts", "interrupts")},
    ),
    Producer(
        "dispersion",
        "./heli python scripts/dispersion_table.py",
        "The paper's hover test on 10 000 aircraft up to 20 % off, law by law.",
        tuple(range(1, 10_001)),
        MARGIN,
    ),
    Producer(
        "dispersion_honest",
        "./heli python scripts/dispersion_table.py --world honest --flights 2000",
        "The same aircraft's hover test in the honest world.",
        tuple(range(1, 2001)),
        MARGIN,
    ),
    Producer(
        "rare",
        "./heli python scripts/rare_table.py",
        "How rarely a hover leaves a bound, and the worst case within 3 sigma.",
        (1,),
        # Which flights a level keeps hangs on rounding: elsewhere it is another sample.
        relative=NOT_COMPARED,
    ),
    Producer(
        "campaign",
        "./heli python benchmarks/campaign.py --json",
        "A campaign on one and two workers, and a worker's memory.",
        loose={
            key: NOT_COMPARED for key in ("rates", "flights_1000_s", "efficiency", "resident_mb")
        },
    ),
    Producer(
        "scaling",
        "./heli python benchmarks/scaling.py --json",
        "What empty tasks of a campaign and participants of a ROS domain cost.",
        loose={
            key: NOT_COMPARED
            for key in ("tasks_per_s", "scheduler_s_per_task", "wall_s", "cpu_s", "seen")
        },
    ),
    Producer(
        "setup",
        "./heli python scripts/setup_time.py",
        "Set-up of a fresh clone with empty caches, to the end of its first flight.",
        loose={
            "installed_mb": 0.1,
            **{
                key: NOT_COMPARED
                for key in ("split_s", "setup_s", "start_up_s", "flight_s", "total_s")
            },
        },
    ),
)
_BY_NAME = {producer.name: producer for producer in PRODUCERS}


def chosen(names: Iterable[str]) -> list[Producer]:
    """Producers by name, all if there are no names.

    Raises
    ------
    ParameterError
        A name that is none of them.
    """
    wanted = list(names)
    for name in wanted:
        if name not in _BY_NAME:
            raise ParameterError(f"results: {name!r} is none of {', '.join(_BY_NAME)}")
    return [_BY_NAME[name] for name in wanted] or list(PRODUCERS)
