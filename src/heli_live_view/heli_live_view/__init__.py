# SPDX-License-Identifier: Apache-2.0
"""Shows a flying graph in a browser and in Foxglove; sends commands behind a token."""
