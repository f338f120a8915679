# SPDX-License-Identifier: Apache-2.0
"""Damaged messages, files and bags for all that reads them; nothing that flies imports it."""
