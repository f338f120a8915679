# SPDX-License-Identifier: Apache-2.0
"""`heli replay`: a recorded flight on the live view's page."""
