# SPDX-License-Identifier: Apache-2.0
"""The simulated helicopter as a MAVLink vehicle, for ground stations and companion computers."""
