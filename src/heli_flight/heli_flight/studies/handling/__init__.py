# SPDX-License-Identifier: Apache-2.0
"""`heli score`: handling qualities of a recorded flight, ours or somebody else's."""
