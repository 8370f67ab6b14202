"""Weights files: safetensors that name their configuration. What can be known of one without PyTorch."""

import hashlib
from collections.abc import Collection
from pathlib import Path

from safetensors import SafetensorError, safe_open

from ..errors import InputError
from .config import CONFIGS, Config

FILE_NAME = "hdn_compact.safetensors"
MATTE_FILE_NAME = "hdn_matte.safetensors"
LIGHT_FILE_NAME = "hdn_light.safetensors"
# The matte and the light network, where HDN's files have the name of a configuration.
MATTE = "matte"
LIGHT = "light"


def shipped(name: str = FILE_NAME) -> Path:
    """Weights that come with the project: inside the installed package, or beside it in a checkout."""
    here = Path(__file__).parents[1]
    installed = here / "assets" / name
    return installed if installed.exists() else here.parent / "assets" / name


def configuration(path: Path) -> Config:
    """The configuration that a weights file of HDN is of.

    Raises:
        InputError: no such file, not a safetensors file, or weights of another architecture.
    """
    return CONFIGS[architecture(path, CONFIGS)]


def architecture(path: Path, known: Collection[str]) -> str:
    """The name, one of the known, of what a weights file is of.

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
    if name not in known:
        raise InputError(f"{path} holds weights of configuration '{name}': this version knows {', '.join(known)}")
    return name


def digest(path: Path) -> str:
    """The file's SHA-256, in hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
