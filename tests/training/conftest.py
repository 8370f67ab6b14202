"""What the tests of training share."""

from pathlib import Path

import cv2
import pytest

from ..scenes import texture


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("images")
    for source, count in (("bsds500", 4), ("kodak", 2)):
        (folder / source).mkdir()
        for i in range(count):
            cv2.imwrite(str(folder / source / f"{i}.png"), texture(i, 200, 160))
    return folder
