"""Submits a shot to OpenCue: track once, then render pictures in chunks.

python submit.py street.mp4 ad.mp4 "476,128 759,122 759,480 482,476" 0-299 "out.%05d.png" --chunk 100
"""

import argparse
import getpass
from pathlib import Path

import outline
import outline.cuerun
from outline.modules.shell import Shell


def job(video: str, ad: str, quad: str, frames: str, output: str, chunk: int) -> outline.Outline:
    """The job: a layer that tracks, and one that renders once that is done."""
    made = outline.Outline("ar-replace", shot=Path(video).stem, show="testing", user=getpass.getuser())
    track = f"{output}.track.json"
    tracking = Shell("track", command=["ar-track", video, "--quad", quad, "-o", track, "--overwrite"], range="1")
    # cuebot puts the numbers in; what is run again after a failure replaces what there is.
    part = ["--frames", "#FRAME_START#-#FRAME_END#", "-o", output, "--overwrite"]
    rendering = Shell("render", command=["ar-replace", video, ad, "--track", track, *part], chunk=chunk, range=frames)
    rendering.depend_all(tracking)
    made.add_layer(tracking)
    made.add_layer(rendering)
    return made


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("video", "ad", "quad", "frames", "output"):
        parser.add_argument(name)
    parser.add_argument("--chunk", type=int, default=100)
    outline.cuerun.launch(job(**vars(parser.parse_args())), use_pycuerun=False)


if __name__ == "__main__":
    main()
