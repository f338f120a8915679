# SPDX-License-Identifier: Apache-2.0
"""A linear aircraft with known truth for the tests of the fits; nothing else imports it."""
