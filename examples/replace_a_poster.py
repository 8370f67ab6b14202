"""Puts an ad on a poster: `python examples/replace_a_poster.py VIDEO AD OUTPUT X,Y X,Y X,Y X,Y`."""

import sys

from ar_demo import OutputOptions, Surface, parse_quad, replace


def main(video: str, ad: str, output: str, *corners: str) -> None:
    surface = Surface(ad, quad=parse_quad(list(corners)), fit="cover", blend="normal")
    result = replace(video, surface, output, options=OutputOptions(overwrite=True))
    print(f"{result.output}: {result.frames} frames, {result.states}")
    for warning in result.warnings:
        print("warning:", warning)


if __name__ == "__main__":
    main(*sys.argv[1:])
