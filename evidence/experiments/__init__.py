# SPDX-License-Identifier: Apache-2.0
"""One file per experiment: what flies, and how it is told."""
