"""What runs on a CPU without PyTorch, and what is said where PyTorch is needed."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hdn.networks.weights import shipped

NO_TORCH = "import sys; sys.modules['torch'] = None  # as if it were not installed\n"

TRACKING = """
import numpy as np
from hdn import Tracker
frame = np.random.default_rng(0).integers(0, 255, (30, 40, 3), np.uint8).repeat(8, 0).repeat(8, 1)
tracker = Tracker()
quad = np.array([[100.0, 60], [220, 60], [220, 180], [100, 180]])
tracker.init(frame, quad)
estimate = tracker.track(frame)
assert estimate.state == "tracked", estimate
assert abs(estimate.corners - quad).max() < 0.5
print(tracker.engine.description)
"""

IMPORTS = """
import importlib, pkgutil
import ar_demo
from hdn.benchmark import cli, running, trackers
for module in pkgutil.walk_packages(ar_demo.__path__, "ar_demo."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
print("imported")
"""

COMMAND = """
import hdn.entry
sys.argv = ["hdn"]
hdn.entry.{}_main()
"""

TRACKER = """
from hdn import InputError, Tracker
try:
    Tracker({})
except InputError as error:
    print(error)
"""


def python(code: str, status: int = 0) -> subprocess.CompletedProcess[str]:
    done = subprocess.run([sys.executable, "-c", NO_TORCH + code], capture_output=True, text=True, timeout=120)
    assert done.returncode == status, done.stderr
    return done


def test_tracks_with_the_shipped_weights() -> None:
    assert python(TRACKING).stdout.strip() == "OpenVINO on the CPU"


def test_the_product_and_the_benchmark_of_trackers_import() -> None:
    assert python(IMPORTS).stdout.strip() == "imported"


@pytest.mark.parametrize("name", ["train", "import", "bench"])
def test_commands_that_take_it_say_what_to_install(name: str) -> None:
    said = python(COMMAND.format(name), status=2).stderr
    assert (
        said == "error: this takes PyTorch, which is not installed: install it with pip install 'ar-replace[torch]'\n"
    )


def test_cuda_takes_it() -> None:
    said = python(TRACKER.format("device='cuda'")).stdout
    assert "--device cuda takes PyTorch" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("stale", [False, True])
def test_weights_without_networks_of_their_own_beside_them_take_it(stale: bool, tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    weights = shipped().read_bytes()
    path.write_bytes(_retrained(weights) if stale else weights)
    if stale:
        shutil.copy(shipped().with_suffix(".openvino.zip"), tmp_path / "w.openvino.zip")
    said = python(TRACKER.format(repr(str(path)))).stdout
    assert f"{path} has no OpenVINO networks of these weights beside it" in said
    assert "pip install 'ar-replace[torch]'" in said


def _retrained(weights: bytes) -> bytes:
    """Other weights of the same shapes."""
    return weights[:-2] + bytes([weights[-2] ^ 1, weights[-1]])
