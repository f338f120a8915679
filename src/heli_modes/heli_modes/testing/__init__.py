# SPDX-License-Identifier: Apache-2.0
"""What only tests use: the picture of the table, against which the README is held."""
