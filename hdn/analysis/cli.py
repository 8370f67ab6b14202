"""`hdn-analyse`: what the paper says of its method, and what the tracker says of itself, measured and drawn."""

import importlib.util
import sys
from collections.abc import Sequence
from pathlib import Path

from ..commandline import DONE, Parser, natural, run
from ..errors import InputError
from ..networks.config import CONFIGS
from . import conditioning, rsew, states


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of hdn-analyse."""
    sys.exit(run(_command, arguments, "what was written so far is kept"))


def _command(arguments: Sequence[str] | None) -> int:
    options = _parser().parse_args(arguments)
    if importlib.util.find_spec("matplotlib") is None:
        raise InputError("figures need Matplotlib: pip install 'ar-replace[bench]'")
    options.out.mkdir(parents=True, exist_ok=True)
    if options.analysis == "rsew":
        lines, paths = rsew.write(options.out, CONFIGS[options.config], options.image)
    elif options.analysis == "states":
        lines, paths = states.write(options.out, options.folders, options.clips, options.frames, options.seed)
    else:
        lines, paths = conditioning.write(options.out, options.samples, options.seed)
    print("\n".join([*lines, *(f"written: {path}" for path in paths)]))
    return DONE


def _parser() -> Parser:
    parser = Parser(
        "hdn-analyse",
        "Reproduce the analysis of 'Homography Decomposition Networks for Planar Object Tracking', and measure how far "
        "the tracker knows how well it does.",
        "Exit status: 0 done, 1 failed while working, 2 wrong input.",
    )
    analyses = parser.add_subparsers(dest="analysis", required=True, parser_class=_Subparser)
    subject = "how hard the parameters of a homography are to find, with and without decomposition: figure and CSV"
    condition_parser = analyses.add_parser("condition-number", help=subject, description=subject)
    condition_parser.add_argument(
        "--samples", type=natural, default=1_000_000, metavar="N", help="homographies drawn (default 1000000)"
    )
    condition_parser.add_argument("--seed", type=natural, default=1, metavar="N", help="of the draw (default 1)")
    subject = "rotation and scale become shifts on the log-polar warp: figure, predicted and measured shifts"
    rsew_parser = analyses.add_parser("rsew", help=subject, description=subject)
    rsew_parser.add_argument(
        "--image", type=Path, metavar="FILE", help="what to rotate and scale (default: a drawn poster)"
    )
    rsew_parser.add_argument("--config", choices=list(CONFIGS), default="compact", help="whose warp (default compact)")
    subject = "states, confidence, deviation and visibility against the truth: table, figure and CSV"
    states_parser = analyses.add_parser("states", help=subject, description=subject)
    states_parser.add_argument(
        "folders", nargs="*", type=Path, metavar="FOLDER", help="of clips with corners, NAME.mp4 beside NAME.json"
    )
    states_parser.add_argument(
        "--clips", type=natural, default=4, metavar="N", help="drawn, textured and of low texture each (default 4)"
    )
    states_parser.add_argument("--frames", type=natural, default=130, metavar="N", help="of each clip (default 130)")
    states_parser.add_argument("--seed", type=natural, default=1, metavar="N", help="of the drawn clips (default 1)")
    for analysis in (condition_parser, rsew_parser, states_parser):
        analysis.add_argument(
            "--out", type=Path, default=Path("runs/analysis"), metavar="DIR", help="default runs/analysis"
        )
    return parser


class _Subparser(Parser):
    """A parser as argparse makes it, with arguments that differ by its version."""

    def __init__(self, prog: str, description: str, **_: object) -> None:
        super().__init__(prog, description)


if __name__ == "__main__":
    main()
