"""Running PyTorch modules through OpenVINO."""

import subprocess
import sys

import pytest

INTERRUPTED_AFTERWARDS = """
import gc, signal, torch
from hdn.networks.conversion import convert
from hdn.networks.openvino import compiled
runs = [compiled(convert(torch.nn.Conv2d(3, 4, 3), torch.zeros(1, 3, 16, 16))) for _ in range(3)]
while runs:
    del runs[0]
    gc.collect()
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where tests run in the background
try:
    signal.raise_signal(signal.SIGINT)
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
def test_ctrl_c_is_safe_once_the_networks_are_gone() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED_AFTERWARDS], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout.strip()) == (0, "interrupted"), done.stderr
