"""Tracks a surface once and lays several ads on it, a video each.

`python examples/track_once_render_often.py VIDEO OUT_FOLDER X,Y X,Y X,Y X,Y AD...`
"""

import sys
from dataclasses import replace
from pathlib import Path

from ar_demo import OutputOptions, Session, Surface, parse_quad


def main(video: str, folder: str, *rest: str) -> None:
    corners, ads = rest[:4], rest[4:]
    with Session(video) as session:
        [tracked] = session.track([Surface(quad=parse_quad(list(corners)))])
        assert tracked.track is not None
        tracked.track.save(Path(folder) / "track.json")
        for ad in ads:
            output = Path(folder) / f"{Path(ad).stem}.mp4"
            session.render([replace(tracked, ad=ad)], output, OutputOptions(overwrite=True))
            print(output)


if __name__ == "__main__":
    main(*sys.argv[1:])
