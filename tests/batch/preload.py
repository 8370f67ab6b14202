"""For `dask worker --preload`, which copies it: jobs are done by the program that STAND_IN names."""

import os
import sys

from ar_demo.batch import process

process.PROGRAM = (sys.executable, "-I", "-S", os.environ["STAND_IN"])
