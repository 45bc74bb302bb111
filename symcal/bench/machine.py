"""The machine that numbers are of, and holding this process to one of its cores."""

from __future__ import annotations

import importlib.metadata
import logging
import os
import platform
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from threadpoolctl import ThreadpoolController

from symcal.kernels.compile import processor
from symcal.kernels.compiler import find_compiler

logger = logging.getLogger(__name__)

_SHOWN = ("sse4_2", "avx", "avx2", "fma", "avx512f", "avx512dq", "avx512vl", "asimd", "sve")
"""Processor flags that decide how many numbers are computed at once."""

_PACKAGES = ("symcal", "numpy", "scipy", "casadi")
PEERS = ("jax", "pin", "figaroh", "robotkinecal")
"""Packages that do a part of the work, by their names on the index; see `symcal.bench.peers`."""

BUSY = 0.5
"""Processes that want to run beside this one, averaged over a minute, from which on times are doubtful."""


def machine() -> dict[str, Any]:
    """Processor, cores, what it can compute at once, compiler, versions, and how busy it is."""
    model, flags = _processor()
    compiler = find_compiler()
    return {
        "processor": model,
        "flags": [flag for flag in _SHOWN if flag in flags],
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "compiler": None if compiler is None else compiler.name,
        "kernels": os.environ.get("SYMCAL_KERNELS", "auto"),
        "python": platform.python_version(),
        "packages": {name: version(name) for name in _PACKAGES},
        "load": load(),
    }


def load() -> float | None:
    """Processes that wanted to run in the last minute, this one included; None where the system does not say."""
    try:
        return round(os.getloadavg()[0], 2)
    except (AttributeError, OSError):
        return None


def version(package: str) -> str | None:
    """Of an installed package; None if it is not installed."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _processor() -> tuple[str, frozenset[str]]:
    facts = {}
    for line in processor().splitlines():
        key, _, value = line.partition(":")
        facts[key.strip().lower()] = value.strip()
    named = facts.get("model name") or platform.processor() or platform.machine()
    if "cpu family" in facts:
        named += f" (family {facts['cpu family']} model {facts.get('model', '?')})"
    return named, frozenset(facts.get("flags", facts.get("features", "")).split())


@contextmanager
def one_core() -> Iterator[None]:
    """One thread of linear algebra, and one core where the system allows it: what is loaded meanwhile sees no other."""
    with ThreadpoolController().limit(limits=1):
        if sys.platform != "linux":
            yield
            return
        allowed = os.sched_getaffinity(0)
        try:
            os.sched_setaffinity(0, {max(allowed)})
        except OSError as error:
            logger.info("this process cannot be held to one core: %s", error)
        try:
            yield
        finally:
            os.sched_setaffinity(0, allowed)
