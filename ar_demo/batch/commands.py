"""What ar-batch does."""

import shlex
from argparse import Namespace

from ..cli.reporting import set_up_logging
from ..errors import InputError

MISSING = "a batch takes packages that are not installed: install them with pip install 'ar-replace[batch]'"


def batch_command(given: Namespace) -> int:
    """ar-batch, by what is given on its command line."""
    set_up_logging("quiet" in given)
    try:
        from .jobs import expand
        from .manifest import load
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] in ("pydantic", "ruamel"):
            raise InputError(MISSING) from error
        raise
    manifest, document = load(given.manifest)
    jobs = expand(manifest, document)
    if "dry_run" in given:
        for job in jobs:
            print(shlex.join(["ar-replace", *job.arguments]))
    return 0
