"""Measuring planar trackers: data sets, metrics, peers to compare with, and the `hdn-eval` command.

`datasets` reads sequences, `trackers` runs over them in `running`, `metrics` compares with the truth, `report` writes.
"""
