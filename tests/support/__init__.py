# SPDX-License-Identifier: Apache-2.0
"""What tests, fuzzers and evidence share: synthetic sensors and flights, damaged files."""
