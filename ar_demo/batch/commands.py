"""What ar-batch does."""

import json
import shlex
from argparse import Namespace
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from hdn.commandline import DONE, FAILED

from ..cli.reporting import set_up_logging
from ..errors import InputError

MISSING = "a batch takes packages that are not installed: install them with pip install 'ar-replace[batch]'"
LOCAL = "local"  # in the place of a scheduler's address
RETRIES = 1  # of a job that failed while working, where nothing is said
CACHE_BYTES = 20 * 10**9  # that addresses' files may have together, where nothing is said
PACKAGES = ("aiohttp", "distributed", "fsspec", "psutil", "pydantic", "ruamel")


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
    from .running import Batch, Ceilings, Pool
    from .staging import Place
    from .state import State
    from .summary import as_json, table, write

    set_up_logging("quiet" in given)
    is_local = getattr(given, "scheduler", LOCAL) == LOCAL
    for name in ("workers",) if not is_local else ("resources",):
        if name in given:
            other = "--scheduler ADDRESS"
            raise InputError(f"--{name} does nothing {'without' if is_local else 'beside'} {other}: leave it out")
    manifest, document = load(given.manifest)
    schemes = tuple(given.schemes.lower().split(",")) if "schemes" in given else SCHEMES
    bounds = Bounds(getattr(given, "root", None), schemes)
    jobs = expand(manifest, document, bounds.check_name)
    for job in jobs:
        try:
            bounds.check(job)
        except InputError as error:
            raise document.wrong(job.keys, str(error)) from error
    names = ("time_limit", "memory_limit", "max_frames", "max_pixels")
    ceilings = Ceilings(**{name: getattr(given, name) for name in names if name in given})
    jobs = [ceilings.bounded(job) for job in jobs]
    if "dry_run" in given:
        for job in jobs:
            print(shlex.join(["ar-replace", *job.arguments]))
        return DONE
    folder: Path = (given.state if "state" in given else given.manifest.with_suffix(".batch")).absolute()
    place = Place(getattr(given, "cache", None), getattr(given, "cache_size", CACHE_BYTES))
    with State(folder) as state, ExitStack() as held:
        pool: Pool
        if is_local:
            workers = getattr(given, "workers", usual_workers())
            pool = held.enter_context(LocalPool(workers, place, [state.lock]))
        else:
            from .cluster import ClusterPool, parse_resources

            resources = parse_resources(getattr(given, "resources", ""))
            pool = held.enter_context(ClusterPool(given.scheduler, resources, replace(place, makes_aside=True)))
        batch = Batch(state, pool, getattr(given, "retries", RETRIES))
        try:
            batch.run(jobs)
        finally:
            write(batch.done, folder, given.manifest.name)
    if "json" in given:
        print(json.dumps(as_json(batch.done)))
    else:
        print(table(batch.done))
    return DONE if all(done.is_good for done in batch.done) else FAILED
