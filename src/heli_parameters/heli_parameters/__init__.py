# SPDX-License-Identifier: Apache-2.0
"""Parameter tables, rcl YAML files, command lines, and where packages have their files; no ROS."""
