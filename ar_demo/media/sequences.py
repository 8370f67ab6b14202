"""Pictures as a video: a sequence, by a name with a place for the number, a folder or a glob; or a single picture."""

from __future__ import annotations

import glob
import logging
import re
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
from av.container import InputContainer

from ..errors import InputError
from .limits import for_probing
from .numbering import Numbering

log = logging.getLogger(__name__)

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".bmp", ".webp", ".tga", ".dpx")
DEFAULT_RATE = Fraction(25)  # frames a second, as FFmpeg takes them


@dataclass(frozen=True)
class ImageSequence:
    """Pictures that are shown one after the other.

    Attributes:
        path: what they are called by.
        files: in their order.
        rate: frames per second.
        numbering: of the files, where they are numbered without gaps; None where they come in the order of their names.
    """

    path: Path
    files: tuple[Path, ...]
    rate: Fraction
    numbering: Numbering | None

    @staticmethod
    def find(path: Path | str, rate: Fraction | None = None) -> ImageSequence | None:
        """The pictures that an input's name stands for; None where it is that of a video file.

        Args:
            path: a picture, a folder of pictures, a name with a place for a number (see `Numbering`), or a glob.
            rate: frames per second; None takes 25, which the log says.

        Raises:
            InputError: no pictures, of several kinds, or one is missing; a rate for what is no sequence.
        """
        path = Path(path)
        files = _files(path)
        if files is None:
            if rate is not None:
                raise InputError(f"--fps is for image sequences, and {path} is none: leave it out")
            return None
        if rate is None and len(files) > 1:
            log.info("%s: its %d pictures are taken at %d frames a second; --fps says otherwise", path, len(files), 25)
        return ImageSequence(path, tuple(files), rate or DEFAULT_RATE, _numbering(files))

    @property
    def first_number(self) -> int:
        """That the first picture has in its name; 0 where they are not numbered without gaps."""
        return 0 if self.numbering is None else self.numbering.number_in(self.files[0])

    def __str__(self) -> str:
        return str(self.path)

    def __fspath__(self) -> str:
        return str(self.path)

    def open(self) -> InputContainer:
        """The pictures as FFmpeg reads them; raises what PyAV does."""
        first = self.files[0]
        if len(self.files) == 1:
            name, options = str(first), {"pattern_type": "none"}
        elif self.numbering is not None:
            name, options = self.numbering.ffmpeg, {"start_number": str(self.first_number)}
        else:
            name = f"{glob.escape(str(first.parent))}/*{first.suffix}"
            options = {"pattern_type": "glob"}
        return av.open(name, format="image2", options=options | {"framerate": str(self.rate)}, **for_probing())


def pictures_of(path: Path) -> list[Path]:
    """The pictures that there are of a sequence's name, with gaps or without; none where it is another name."""
    numbering = None if path.exists() else Numbering.parse(path)
    if numbering is not None:
        return [numbering.file(number) for number in numbering.numbers()]
    if path.is_dir():
        return [file for file in path.iterdir() if file.suffix.lower() in SUFFIXES]
    return _matching(path) if glob.has_magic(str(path)) and not path.exists() else []


def parse_rate(text: str | float) -> Fraction:
    """Frames per second: 24, '23.976' (24000/1001), '30000/1001'.

    Raises:
        InputError: no such number.
    """
    try:
        rate = Fraction(str(text))
    except (ValueError, ZeroDivisionError):
        rate = Fraction(0)
    if not Fraction(1, 1000) <= rate <= 1000:
        raise InputError(f"fps '{text}' is no frame rate: give a number, as 24, 23.976 or 30000/1001")
    of_television = Fraction(round(rate * 1001 / 1000) * 1000, 1001)
    return of_television if abs(rate - of_television) < Fraction(1, 200) else rate


def _files(path: Path) -> list[Path] | None:
    """The pictures, in order; None where the name is that of something else."""
    if path.is_dir():
        return _of_one_kind(path, [file for file in path.iterdir() if file.suffix.lower() in SUFFIXES])
    if path.exists() or path.suffix.lower() not in SUFFIXES:
        return [path] if path.is_file() and path.suffix.lower() in SUFFIXES else None
    numbering = Numbering.parse(path)
    if numbering is not None:
        numbers = numbering.numbers()
        if not numbers:
            raise InputError(f"there is no picture {path}: check the name")
        missing = sorted(set(range(numbers[0], numbers[-1])) - set(numbers))
        if missing:
            raise InputError(
                f"{numbering.file(missing[0])} is missing ({len(missing)} of {path} in all): "
                "add it, or give the folder, whose pictures are taken in their order"
            )
        return [numbering.file(number) for number in numbers]
    if glob.has_magic(str(path)):
        return _of_one_kind(path, _matching(path))
    return None


def _matching(pattern: Path) -> list[Path]:
    """The files that a glob stands for; in a folder that is there nothing of its name is a pattern."""
    if pattern.parent.is_dir():
        return list(pattern.parent.glob(pattern.name))
    return [Path(name) for name in glob.glob(str(pattern))]


def _of_one_kind(path: Path, files: list[Path]) -> list[Path]:
    files = [file for file in files if file.is_file() and not file.name.startswith(".")]
    if not files:
        raise InputError(f"{path} has no pictures: give a video, or pictures that end in {', '.join(SUFFIXES)}")
    kinds = sorted({file.suffix for file in files})
    if len(kinds) > 1 or len({file.parent for file in files}) > 1:
        raise InputError(f"{path} has pictures of several kinds ({', '.join(kinds)}): name one, as in '{path}/*.png'")
    return sorted(files, key=_natural)


def _natural(file: Path) -> list[tuple[int, str]]:
    """By which a2 comes before a10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", file.name) if part]


def _numbering(files: list[Path]) -> Numbering | None:
    """How pictures, in their order, are numbered without gaps.

    Raises:
        InputError: they are not, and there is another order in which FFmpeg would read them, or there are others.
    """
    numbering = Numbering.of(files[0])
    if numbering is not None:
        first = numbering.number_in(files[0])
        if all(file == numbering.file(first + index) for index, file in enumerate(files)):
            return numbering
    if len(files) == 1:
        return None
    kin = [file for file in files[0].parent.iterdir() if file.suffix == files[0].suffix]
    if sorted(files) != files or len(kin) != len(files):
        raise InputError(f"{files[0].name} and the others are not numbered 1, 2, 3 ...: rename them, or make a folder")
    log.info("%s and the others are not numbered without gaps: they are taken in their order", files[0].name)
    return None
