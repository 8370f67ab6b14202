"""Writing single pictures."""

from pathlib import Path

import cv2

from hdn.imaging.arrays import Image

from ..errors import InputError
from .claims import Claim, write_whole

SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff")


def check_picture_name(path: Path) -> None:
    """Raises InputError for a name whose ending is not that of a picture."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: a picture must end in one of {', '.join(SUFFIXES)}")


def write_picture(output: Path | Claim, picture: Image) -> None:
    """Writes an RGB picture (h, w, 3), whole or not at all, in the format that the name ends in.

    Raises:
        InputError: the name has another ending.
        RunError: it cannot be written.
    """
    path = output.path if isinstance(output, Claim) else output
    check_picture_name(path)
    _, encoded = cv2.imencode(path.suffix.lower(), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    write_whole(output, encoded.tobytes())
