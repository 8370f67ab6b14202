"""Shows what a window would: progress, a preview picture now and then, and a button that stops the work.

`python examples/preview_and_stop.py VIDEO AD OUTPUT PREVIEW.png X,Y X,Y X,Y X,Y`; here the "button" is pressed after a
second of video was rendered.
"""

import sys

import cv2

from ar_demo import OutputOptions, Progress, Session, Stopped, Surface, parse_quad

STOP_AFTER = 30  # frames rendered


def main(video: str, ad: str, output: str, preview: str, *corners: str) -> None:
    def listen(event: Progress) -> None:
        if event.done % 10 == 0 and event.preview is not None:
            print(f"{event.stage}: {event.done} of {event.total or '?'}, {event.state}")
            cv2.imwrite(preview, cv2.cvtColor(event.preview, cv2.COLOR_RGB2BGR))
        if event.stage == "render" and event.done == STOP_AFTER:
            session.stop()  # from a window this comes from another thread

    with Session(video, listen) as session:
        surfaces = session.track([Surface(ad, quad=parse_quad(list(corners)))])
        try:
            session.render(surfaces, output, OutputOptions(overwrite=True))
        except Stopped:
            print("stopped: no output was written")


if __name__ == "__main__":
    main(*sys.argv[1:])
