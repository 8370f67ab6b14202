"""What ar-batch does."""

import json
import shlex
from argparse import Namespace
from pathlib import Path

from hdn.commandline import DONE, FAILED

from ..cli.reporting import set_up_logging
from ..errors import InputError

MISSING = "a batch takes packages that are not installed: install them with pip install 'ar-replace[batch]'"
PACKAGES = ("distributed", "fsspec", "psutil", "pydantic", "ruamel")


def batch_command(given: Namespace) -> int:
    """ar-batch, by what is given on its command line."""
    try:
        return _batch(given)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] in PACKAGES:
            raise InputError(MISSING) from error
        raise


def _batch(given: Namespace) -> int:
    from .bounds import SCHEMES, Bounds
    from .jobs import expand
    from .local import LocalPool, usual_workers
    from .manifest import load
    from .running import Batch, Settings
    from .state import State
    from .summary import as_json, table, write

    set_up_logging("quiet" in given)
    manifest, document = load(given.manifest)
    jobs = expand(manifest, document)
    schemes = tuple(given.schemes.lower().split(",")) if "schemes" in given else SCHEMES
    bounds = Bounds(getattr(given, "root", None), schemes)
    for job in jobs:
        try:
            bounds.check(job)
        except InputError as error:
            raise document.wrong(job.keys, str(error)) from error
    if "dry_run" in given:
        for job in jobs:
            print(shlex.join(["ar-replace", *job.arguments]))
        return DONE
    names = ("retries", "time_limit", "memory_limit", "max_frames", "max_pixels")
    settings = Settings(**{name: getattr(given, name) for name in names if name in given})
    folder: Path = given.state if "state" in given else given.manifest.with_suffix(".batch")
    with State(folder) as state, LocalPool(getattr(given, "workers", usual_workers()), [state.lock]) as pool:
        batch = Batch(state, pool, settings)
        try:
            batch.run(jobs)
        finally:
            write(batch.done, folder, given.manifest.name)
    if "json" in given:
        print(json.dumps(as_json(batch.done)))
    else:
        print(table(batch.done))
    return DONE if all(done.is_good for done in batch.done) else FAILED
