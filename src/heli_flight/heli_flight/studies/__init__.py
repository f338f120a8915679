# SPDX-License-Identifier: Apache-2.0
"""What takes many flights or a design: campaigns, comparisons, designs, identification."""
