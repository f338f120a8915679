# SPDX-License-Identifier: Apache-2.0
"""Which command makes which result file: speed, endurance, many flights."""

from heli_flight.studies.results.producer import MARGIN, NOT_COMPARED, Producer

OF_SCALE = (
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
    Producer(
        "setup_size",
        "./heli python scripts/setup_size.py",
        "What set-up downloads and takes of the disk, by the files that are pinned.",
        loose={
            **{
                f"{name}_mb": 0.2
                for name in ("download", "flight", "uv", "test", "disk", "test_disk")
            },
            **{f"{name}_files": 0.1 for name in ("flight", "uv", "test")},
        },
    ),
)
