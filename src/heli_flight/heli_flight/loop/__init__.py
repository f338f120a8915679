# SPDX-License-Identifier: Apache-2.0
"""The whole loop in one process, without ROS: settings, scenarios, flight, record, score."""
