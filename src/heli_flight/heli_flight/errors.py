# SPDX-License-Identifier: Apache-2.0
"""Named causes for a flight that could not be made."""


class FlightError(Exception):
    """The graph could not be brought up or kept up; the message is one line for the user."""


class StartError(FlightError):
    """The graph could not be brought up; nothing was flown."""


class BrokenFlightError(FlightError):
    """The graph broke in flight; what was recorded until then is kept."""
