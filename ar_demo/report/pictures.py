"""Pictures inside a page: JPEG as text, each of at most so many bytes."""

from base64 import b64encode
from dataclasses import dataclass
from html import escape

import cv2
import numpy as np

from hdn.imaging.arrays import Image

QUALITIES = (82, 65, 45, 25)  # of JPEG, tried until a picture is small enough


@dataclass(frozen=True)
class Picture:
    """A picture in a page.

    Attributes:
        source: its data URL. width, height: px.
    """

    source: str
    width: int
    height: int

    @classmethod
    def of(cls, image: Image, most_bytes: int) -> "Picture":
        """An RGB image (H, W, 3); it is made smaller where no quality is low enough."""
        while True:
            for quality in QUALITIES:
                bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
                _, encoded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
                if len(encoded) <= most_bytes or min(image.shape[:2]) < 16:
                    source = "data:image/jpeg;base64," + b64encode(encoded.tobytes()).decode()
                    return cls(source, image.shape[1], image.shape[0])
            image = np.asarray(cv2.resize(image, None, fx=0.7, fy=0.7, interpolation=cv2.INTER_AREA), np.uint8)

    def html(self, alt: str, stretched: bool = False) -> str:
        """The picture, with words for those who do not see it; stretched: over its place, whatever its shape."""
        kind = " class='stretched'" if stretched else ""
        return f"<img src='{self.source}' width='{self.width}' height='{self.height}' alt='{escape(alt)}'{kind}>"


def at_most(image: Image, width: int) -> Image:
    """An image (H, W, ...), made smaller where it is wider than so many px."""
    if image.shape[1] <= width:
        return image
    size = width, max(1, round(image.shape[0] * width / image.shape[1]))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
