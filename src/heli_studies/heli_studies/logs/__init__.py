# SPDX-License-Identifier: Apache-2.0
"""Flight logs of others, read into signals with one name, unit, frame and sign each."""
