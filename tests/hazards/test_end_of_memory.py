"""A picture whose last pixel is the last byte that may be read: swscale, which converts it, reads on."""

import subprocess
import sys

import pytest

GUARDED = """
import ctypes, mmap, sys
import numpy as np
from ar_demo.media.color import FromRGB

width, height = 142, 100
length, page = width * height * 3, mmap.PAGESIZE
size = -(-length // page) * page + page
memory = mmap.mmap(-1, size)
pixels = np.frombuffer(memory, np.uint8)
protected = ctypes.c_void_p(pixels.ctypes.data + size - page)
assert ctypes.CDLL(None).mprotect(protected, ctypes.c_size_t(page), 0) == 0  # PROT_NONE
image = pixels[size - page - length : size - page].reshape(height, width, 3)
image[:] = 100
frame = FromRGB(sys.argv[1])(image)
print(frame.width, frame.height)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="it takes mprotect")
@pytest.mark.parametrize("pix_fmt", ["yuv420p", "yuv444p10le"])
def test_nothing_is_read_beyond_a_picture(pix_fmt: str) -> None:
    done = subprocess.run([sys.executable, "-c", GUARDED, pix_fmt], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, "142 100\n"), done.stderr
