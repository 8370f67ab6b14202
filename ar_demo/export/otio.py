"""OpenTimelineIO: a timeline of one clip, with the track as the clip's metadata and lost frames as markers."""

from pathlib import Path

from ..errors import InputError
from .coordinates import BL, BR, TL, TR
from .csv_table import LEGEND
from .keys import Keys, printable

NAMES = {"top_left": TL, "top_right": TR, "bottom_right": BR, "bottom_left": BL}


def timeline(keys: Keys) -> str:
    """A timeline, as JSON (.otio).

    Raises:
        InputError: OpenTimelineIO is not installed.
    """
    try:
        import opentimelineio as io
    except ModuleNotFoundError as error:
        raise InputError("this needs OpenTimelineIO: pip install 'ar-replace[otio]'") from error
    source, rate = keys.track.source, float(keys.track.source.fps)

    def span(first: int, last: int) -> io.opentime.TimeRange:
        return io.opentime.TimeRange(
            io.opentime.RationalTime(first, rate), io.opentime.RationalTime(last - first + 1, rate)
        )

    whole = span(keys.first_frame, keys.first_frame + len(keys.track) - 1)
    marks = [(span(*run), "lost", io.schema.MarkerColor.RED) for run in keys.lost_runs]
    marks += [(span(cut, cut), "another shot begins", io.schema.MarkerColor.YELLOW) for cut in keys.cuts]
    clip = io.schema.Clip(
        name=printable(Path(source.path).stem),
        media_reference=io.schema.ExternalReference(target_url=printable(source.path), available_range=whole),
        source_range=whole,
        markers=[io.schema.Marker(name=text, marked_range=where, color=color) for where, text, color in marks],
        metadata={
            "ar_replace": {
                "notes": [*keys.notes, *LEGEND],
                "width": source.width,
                "height": source.height,
                "frames": keys.frames,
                "states": [keys.track.states[index] for index in keys.indices],
                "corners": {name: keys.corners[:, place].round(4).tolist() for name, place in NAMES.items()},
            }
        },
    )
    track = io.schema.Track(name="surface", kind=io.schema.TrackKind.Video, children=[clip])
    made = io.schema.Timeline(name=clip.name, tracks=[track], global_start_time=whole.start_time)
    return str(io.adapters.write_to_string(made, "otio_json")) + "\n"
