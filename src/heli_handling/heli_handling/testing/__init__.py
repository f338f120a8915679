# SPDX-License-Identifier: Apache-2.0
"""Made-up flights, for tests of the scorer; nothing that flies imports it."""
