"""The suite as other machines run it: under four instruction sets, each in another random order.

`python -m tests.matrix [arguments of pytest]` from the repository's root, for instance `python -m tests.matrix
tests/networks -x`; `--sets native sse4.2` chooses, `--seed 7` is the first order. It needs pytest-randomly and an x86
processor; what that lacks is left out. It ends at the first set in which a test fails, and says how to repeat that.
"""

import argparse
import os
import subprocess
import sys

import cv2
from numpy._core import _multiarray_umath as numpy_core

# What each library calls the sets that it has code for, from the oldest; each is told to use none beyond.
ORDER = ("sse3", "sse4.2", "avx2", "native")
OPENCV = {"SSE4.1": "sse4.2", "SSE4.2": "sse4.2", "AVX": "avx2", "FP16": "avx2", "AVX2": "avx2"}
NUMPY = {"X86_V3": "avx2"}  # all others that it knows to choose are AVX-512
OPENBLAS = {"sse3": "Prescott", "sse4.2": "Nehalem", "avx2": "Haswell"}
MKL = {"sse3": "SSE4_2", "sse4.2": "SSE4_2", "avx2": "AVX2"}
PYTORCH = {"sse3": "default", "sse4.2": "default", "avx2": "avx2"}
# OpenVINO, whose networks run on oneDNN as well, cannot compile some of them where this says less than AVX.
ONEDNN = {"sse3": "AVX", "sse4.2": "AVX", "avx2": "AVX2"}


def environment(instructions: str) -> dict[str, str]:
    """The variables that keep NumPy, OpenCV, OpenBLAS, MKL, PyTorch, oneDNN and OpenVINO to a set of ORDER."""
    if instructions == "native":
        return {}

    def beyond(name: str, known: dict[str, str]) -> bool:
        return ORDER.index(known.get(name, "native")) > ORDER.index(instructions)

    opencv = [name[1:] for name in cv2.getCPUFeaturesLine().split() if name[0] == "*" and name[-1] != "?"]
    features = numpy_core.__cpu_features__
    numpy = [name for name in numpy_core.__cpu_dispatch__ if features.get(name)]
    return {
        "OPENCV_CPU_DISABLE": ",".join(name for name in opencv if beyond(name, OPENCV)),
        "NPY_DISABLE_CPU_FEATURES": " ".join(name for name in numpy if beyond(name, NUMPY)),
        "OPENBLAS_CORETYPE": OPENBLAS[instructions],
        "MKL_ENABLE_INSTRUCTIONS": MKL[instructions],
        "ATEN_CPU_CAPABILITY": PYTORCH[instructions],
        "ONEDNN_MAX_CPU_ISA": ONEDNN[instructions],
    }


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.matrix", description=__doc__)
    parser.add_argument("--sets", nargs="+", choices=ORDER, default=list(ORDER))
    parser.add_argument("--seed", type=int, default=1, help="of the first set's order; the next has the next one")
    options, pytest_arguments = parser.parse_known_args()
    for number, instructions in enumerate(options.sets):
        variables = environment(instructions)
        order = ["-p", "no:cacheprovider", f"--randomly-seed={options.seed + number}"]
        command = [sys.executable, "-m", "pytest", *order, *pytest_arguments]
        shown = " ".join([*(f"{name}='{value}'" for name, value in variables.items()), *command])
        print(f"== {instructions}: {shown}", flush=True)
        if status := subprocess.run(command, env=os.environ | variables, check=False).returncode:
            print(f"== failed with {instructions}; repeat it by the line above", flush=True)
            return status
    return 0


if __name__ == "__main__":
    sys.exit(main())
