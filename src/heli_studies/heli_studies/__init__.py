# SPDX-License-Identifier: Apache-2.0
"""The numbers that the READMEs publish: commands make result files, result files make tables.

`registry` says which command makes which file of docs/results, `files` runs it and compares a file
with a fresh run, `tables` turns files into Markdown, `markdown` puts that into the READMEs.
"""
