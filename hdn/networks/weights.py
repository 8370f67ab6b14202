"""Weights files: safetensors that name their configuration. What can be known of one without PyTorch."""

import hashlib
from pathlib import Path

from safetensors import SafetensorError, safe_open

from ..errors import InputError
from .config import CONFIGS, Config

FILE_NAME = "hdn_compact.safetensors"


def shipped() -> Path:
    """The weights that come with the project: inside the installed package, or beside it in a checkout."""
    here = Path(__file__).parents[1]
    installed = here / "assets" / FILE_NAME
    return installed if installed.exists() else here.parent / "assets" / FILE_NAME


def configuration(path: Path) -> Config:
    """The configuration that a weights file is of.

    Raises:
        InputError: no such file, not a safetensors file, or weights of another architecture.
    """
    if not path.is_file():
        raise InputError(f"weights file {path} is missing: name an existing one with --weights, or leave it out")
    try:
        with safe_open(path, framework="np") as file:
            name = (file.metadata() or {}).get("config", "")
    except (SafetensorError, OSError) as error:
        raise InputError(
            f"{path} is not a safetensors file ({error}): give weights written by hdn-train or hdn-import"
        ) from error
    if name not in CONFIGS:
        raise InputError(f"{path} holds weights of configuration '{name}': this version knows {', '.join(CONFIGS)}")
    return CONFIGS[name]


def digest(path: Path) -> str:
    """The file's SHA-256, in hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
