# SPDX-License-Identifier: Apache-2.0
"""Where on the earth the origin of the NED frame may lie."""

LATITUDE_DEG = 85.0
"""Largest magnitude; near a pole east and north have no meaning."""
LONGITUDE_DEG = 180.0
