"""Writing a track for other programs, in as many formats at once as there are files."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from ..choices import LostKeys
from ..errors import InputError
from ..media.claims import Claim, write_whole
from ..surface import check_choices
from ..tracks import Track
from .formats import Exporter, choose
from .keys import keys_of


@dataclass(frozen=True)
class ExportOptions:
    """How tracks are exported.

    Attributes:
        first_frame: the number of the video's first frame in the other program; None for that of an image sequence's
            first picture, or the program's usual.
        size: (width, height) px of the picture that is pinned; None for the video's.
        lost_keys: whether lost frames hold the corners before them, or are left out.

    Raises:
        InputError: a value that is not allowed.
    """

    first_frame: int | None = None
    size: tuple[int, int] | None = None
    lost_keys: LostKeys = "hold"

    def __post_init__(self) -> None:
        check_choices(self)
        if self.size is not None and min(self.size) < 1:
            raise InputError(f"size {self.size[0]}x{self.size[1]} is no picture's: give width and height in px")


def export_track(
    track: Track, files: Sequence[Path | str | Claim], formats: Sequence[str] = (), options: ExportOptions | None = None
) -> list[str]:
    """Writes a track to files of other programs, each whole or not at all; what is there is replaced.

    Args:
        files: each a name, or a claim on one.
        formats: see `choose`.

    Returns:
        What had better be known, one sentence each.

    Raises:
        InputError: a format that is unknown, an option that does nothing in any of them, no pose in any frame.
        RunError: a file cannot be written.

    Example:
        export_track(Track.load("track.json"), ["pin.nk", "pin.txt"], options=ExportOptions(first_frame=1001))
    """
    options = options or ExportOptions()
    paths = [file.path if isinstance(file, Claim) else Path(file) for file in files]
    chosen = choose(paths, formats)
    check_options(chosen, options)
    texts = []
    for exporter in chosen:
        said = (options.first_frame, track.source.first_number, exporter.first_frame)
        first = next(number for number in said if number is not None)
        texts.append(exporter.write(keys_of(track, first, options.size, options.lost_keys)))
    for file, text in zip(files, texts, strict=True):
        write_whole(file, text.encode())
    by_number = [path.name for path, exporter in zip(paths, chosen, strict=True) if not exporter.timed]
    if by_number and not track.is_steady:
        return [f"the video's frame rate varies, and keys in {', '.join(by_number)} go by its frames: bring it in so"]
    return []


def check_options(chosen: Sequence[Exporter], options: ExportOptions) -> None:
    """Raises InputError for an option that makes no difference to any of the formats."""
    for field in fields(options):
        used = any(field.name in exporter.options for exporter in chosen)
        if getattr(options, field.name) != field.default and not used:
            names = ", ".join(dict.fromkeys(exporter.name for exporter in chosen))
            raise InputError(f"{field.name} makes no difference to format {names}: leave it out")
