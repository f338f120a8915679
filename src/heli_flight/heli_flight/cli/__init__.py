# SPDX-License-Identifier: Apache-2.0
"""The commands: ./hover_test.sh and heli."""
