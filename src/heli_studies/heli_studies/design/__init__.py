# SPDX-License-Identifier: Apache-2.0
"""Design of the loops: searches, rival controllers, report."""
