# SPDX-License-Identifier: Apache-2.0
"""A flight's report: a page for the browser and figures for a paper."""

from heli_flight.report.data import Event, events_of
from heli_flight.report.from_bag import STEPS, Choice, Recorded, recorded, report_of, report_of_bag
from heli_flight.report.write import FIGURES, PAGE, write_report

__all__ = [
    "FIGURES",
    "PAGE",
    "STEPS",
    "Choice",
    "Event",
    "Recorded",
    "events_of",
    "recorded",
    "report_of",
    "report_of_bag",
    "write_report",
]
