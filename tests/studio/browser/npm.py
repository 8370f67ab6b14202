"""The page's sources and their packages, installed by npm where it can."""

import shutil
import subprocess
from functools import cache
from pathlib import Path

STATIC = Path(__file__).parents[3] / "ar_demo" / "studio" / "static"
WEB = STATIC.with_name("web")
TO_INSTALL_SECONDS = 120


@cache
def installed() -> bool:
    """Whether the packages of the lock file are there; they are installed where they are not."""
    if shutil.which("npm") is None:
        return False
    if (WEB / "node_modules" / ".package-lock.json").exists():
        return True
    quiet = ["--ignore-scripts", "--no-audit", "--no-fund", "--silent"]
    try:
        return subprocess.run(["npm", "ci", *quiet], cwd=WEB, timeout=TO_INSTALL_SECONDS).returncode == 0
    except subprocess.TimeoutExpired:
        return False
