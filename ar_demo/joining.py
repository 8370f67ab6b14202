"""A video out of parts that were rendered by themselves, on one machine or on many."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .errors import InputError
from .media.joining import join as join_packets
from .media.reader import VideoReader
from .media.sequences import ImageSequence
from .media.streams import Streams
from .options import OutputOptions
from .session import claimed_output


@dataclass(frozen=True)
class Joined:
    """What was joined: frames in it, and what went differently from what was asked, one sentence each."""

    frames: int
    warnings: list[str]


def join(
    input: Path | str | ImageSequence,
    parts: Sequence[Path | str],
    output: Path | str,
    options: OutputOptions | None = None,
) -> Joined:
    """Joins parts of a video that `--frames` rendered, without encoding them anew.

    Args:
        input: the video that they are of, whose sound, subtitles and times the output gets.
        parts: in their order, rendered with the same options: all frames of the video, each once.
        output: the video to write, with the parts' ending.
        options: whose sound, which streams, and whether an output is replaced; all else was said of the parts.

    Raises:
        InputError: parts that are not alike or not all, or an output that cannot be.
        RunError: the output cannot be written.
    """
    options, files = options or OutputOptions(), [Path(part) for part in parts]
    if options.audio not in ("source", "none"):
        raise InputError(
            f"audio {options.audio} needs the ad, of which parts have the picture alone: give source or none"
        )
    with VideoReader(input) as reader, claimed_output(output, options, reader.path, *files) as claim:
        if not reader.seekable:
            for _ in reader.frames():
                pass
        times = reader.times
        [last] = reader.frames(len(times) - 1)
        streams = Streams(options.audio, reader.path, keep=options.streams, location=options.location)
        join_packets(files, claim, times, last.time + last.duration, streams, reader.info)
        return Joined(len(times), [*reader.warnings, *streams.warnings])
