"""Names of image sequences: 'shot.%05d.png', or 'shot.#####.png', is all of shot.00000.png, shot.00001.png ..."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

_NUMBER = re.compile(r"%0?(\d*)d|(#+)")


@dataclass(frozen=True)
class Numbering:
    """The names of the pictures of a sequence.

    Attributes:
        folder: that they are in.
        head, tail: what is before and after the number.
        digits: that it has at least, filled up with zeros.
    """

    folder: Path
    head: str
    digits: int
    tail: str

    @staticmethod
    def parse(path: Path) -> Numbering | None:
        """Reads a name with a place for a number; None where it has none, or several."""
        found = list(_NUMBER.finditer(path.name))
        if len(found) != 1:
            return None
        [match] = found
        digits = len(match[2]) if match[2] else int(match[1] or 1)
        return Numbering(path.parent, path.name[: match.start()], digits, path.name[match.end() :])

    @staticmethod
    def of(file: Path) -> Numbering | None:
        """Of a picture that has a number before its ending; None where it has none."""
        match = re.fullmatch(r"(.*?)(\d+)(\D*)", file.name)
        if match is None:
            return None
        digits = len(match[2]) if match[2].startswith("0") else 1
        return Numbering(file.parent, match[1], digits, match[3])

    def file(self, number: int) -> Path:
        """The picture of a number."""
        return self.folder / f"{self.head}{number:0{self.digits}d}{self.tail}"

    def number_in(self, file: Path) -> int:
        """The number of a picture of the sequence."""
        return int(file.name[len(self.head) : len(file.name) - len(self.tail)])

    def numbers(self) -> list[int]:
        """Of the pictures that there are, in order."""
        pattern = re.compile(f"{re.escape(self.head)}(\\d{{{self.digits},}}){re.escape(self.tail)}")
        matches = [pattern.fullmatch(file.name) for file in self.folder.iterdir()] if self.folder.is_dir() else []
        found = [int(match[1]) for match in matches if match]
        return sorted(number for number in found if self.file(number).is_file())

    @property
    def ffmpeg(self) -> str:
        """As FFmpeg writes it."""
        folder, head, tail = (text.replace("%", "%%") for text in (str(self.folder), self.head, self.tail))
        return f"{folder}/{head}%0{self.digits}d{tail}"
