# SPDX-License-Identifier: Apache-2.0
"""The numbers that the documents publish: what is flown for each, and how it is told.

In a checkout of the repository only, and no part of what is installed. `experiments` holds one file
each; `registry` knows them, `sweep` has the one loop in which they fly, `files` runs a command and
compares a file of docs/results with a fresh run, `markdown` puts tables into the documents, `cli`
is the command `heli results`.
"""
