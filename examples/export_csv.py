"""A track as a table: `python examples/export_csv.py track.json corners.csv`.

Corners are px, x right, y down, the centre of the top-left pixel being (0, 0).
"""

import csv
import sys

from ar_demo import Track


def main(source: str, output: str) -> None:
    track = Track.load(source)
    with open(output, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["frame", "seconds", "state", *(f"{axis}{n}" for n in range(1, 5) for axis in "xy")])
        for index, (time, state, corners) in enumerate(zip(track.times, track.states, track.corners, strict=True)):
            table.writerow([index, f"{float(time):.6f}", state, *(f"{v:.4f}" for v in corners.ravel())])


if __name__ == "__main__":
    main(*sys.argv[1:])
