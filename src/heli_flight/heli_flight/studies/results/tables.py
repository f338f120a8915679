# SPDX-License-Identifier: Apache-2.0
"""Every table that a Markdown file can hold between `results` markers."""

from collections.abc import Callable, Mapping

from heli_flight.studies.results import tables_beside_paper as beside
from heli_flight.studies.results import tables_of_campaigns as campaigns
from heli_flight.studies.results import tables_of_flights as flights
from heli_flight.studies.results import tables_of_ground as of_ground
from heli_flight.studies.results import tables_of_handling as handling
from heli_flight.studies.results import tables_of_laws as of_laws
from heli_flight.studies.results import tables_of_links as of_links
from heli_flight.studies.results import tables_of_parts as parts
from heli_flight.studies.results import tables_of_position as position
from heli_flight.studies.results import tables_of_processes as of_processes
from heli_flight.studies.results import tables_of_scale as of_scale
from heli_flight.studies.results import tables_of_speed as of_speed
from heli_flight.studies.results import tables_of_terms as terms
from heli_flight.studies.results import tables_of_worlds as around
from heli_flight.studies.results.files import Results

TABLES: Mapping[str, Callable[[Results], str]] = {
    "paper": beside.paper,
    "worlds": around.worlds,
    "worlds_paper": around.worlds_paper,
    "w20": around.w20,
    "laws": flights.laws,
    "laws_in_full": flights.laws_in_full,
    "laws_everywhere": of_laws.laws_everywhere,
    "paper_causes": of_laws.paper_causes,
    "position_floor": position.position_floor,
    "paths": position.paths,
    "takeoff": position.takeoff,
    "failsafes": of_ground.failsafes,
    "actuator_faults": of_ground.actuator_faults,
    "engine_out": of_ground.engine_out,
    "links": of_links.links,
    "blind_landing": of_ground.blind_landing,
    "into_wind": position.into_wind,
    "sequence": position.sequence,
    "sequence_changes": position.sequence_changes,
    "rates": position.rates,
    "mte": handling.mte,
    "mte_short": handling.mte_short,
    "response": handling.response,
    "position_doubts": position.position_doubts,
    "robustness": flights.robustness,
    "robust": of_laws.robust,
    "gamma": of_laws.gamma,
    "airspeed": of_speed.airspeed,
    "airspeed_flown": of_speed.airspeed_flown,
    "identification": flights.identification,
    "loops": parts.loops,
    "observer_gains": parts.observer_gains,
    "pid_axes": parts.pid_axes,
    "fusion": parts.fusion,
    "navigation": parts.navigation,
    "dead_reckoning": parts.dead_reckoning,
    "deviations": parts.deviations,
    "term_effects": terms.term_effects,
    "term_deviations": terms.term_deviations,
    "term_tilts": terms.term_tilts,
    "term_flights": terms.term_flights,
    "touch_downs": of_ground.touch_downs,
    "rollover": of_ground.rollover,
    "cpu_types": parts.cpu_types,
    "recorder": parts.recorder,
    "setup": parts.setup,
    "closed_loop": of_scale.closed_loop,
    "graph": of_scale.graph,
    "latency": of_scale.latency,
    "respawn": of_processes.respawn,
    "fuzz": of_scale.fuzz,
    "soak": of_scale.soak,
    "latency_400": of_scale.latency_400,
    "scaling": of_scale.scaling,
    "tasks": of_scale.tasks,
    "workers": of_scale.workers,
    "dispersion": campaigns.dispersion,
    "rare": campaigns.rare,
    "worst_case": campaigns.worst_case,
}
