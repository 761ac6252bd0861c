"""The cache: one folder of generated sources and machine code, checked when read, and never needed.

The folder is $PHASEBENCH_CACHE, else what the platform has for caches.  Its entries stand in a subfolder whose name is
the hash of all that they depend on (this package's source, the versions of what generates and compiles, the
processor), so that nothing stale is ever found.  An entry begins with the hash of its name and content: what was
truncated or changed is removed and made again.  It is written whole, by a rename, whoever else writes it; what takes
long is made by one process, for which others wait (`alone`).  Where nothing can be written the work goes on without,
after one line of warning.

Subfolders of other versions go, the longest unused first, when all together are larger than `BOUND`; then this
version's own oldest entries.
"""

from __future__ import annotations

import hashlib
import importlib.util
import logging
import os
import platform
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path

#: The largest size of the folder, in bytes.
BOUND = 500_000_000
#: Seconds after which a file that was to be renamed, or a lock, is one that a killed process left.
ABANDONED = 3600
#: Seconds that a process waits at most for another to make an entry, and between two looks.
PATIENCE, PAUSE = 60.0, 0.01

_VERSION = re.compile(r"py\d+-[0-9a-f]{16}")
_log = logging.getLogger("phasebench")
#: Why this process could not write, once it has said so.
_said: list[OSError] = []


def root() -> Path | None:
    """The folder of all versions; None where the platform names none."""
    try:
        place = os.environ.get("PHASEBENCH_CACHE")
        if place:
            return Path(place).expanduser()
        import platformdirs

        return Path(platformdirs.user_cache_dir("phasebench", appauthor=False))
    except (OSError, RuntimeError, ImportError):
        return None


@lru_cache(maxsize=1)
def version() -> str:
    """The name of the subfolder: the hash of what its entries depend on."""
    digest = hashlib.sha256()
    folder = Path(__file__).parents[1]
    for path in sorted(folder.glob("**/*.py")):
        digest.update(f"{path.relative_to(folder).as_posix()} ".encode() + path.read_bytes())
    digest.update(repr([sys.version, platform.machine(), *_makers(), *_processor()]).encode())
    return f"py{sys.version_info[0]}{sys.version_info[1]}-{digest.hexdigest()[:16]}"


def _makers() -> list[str]:
    """The versions of the packages that generate and compile.

    SymPy is not imported for it: where everything is in the cache it is not needed.
    """
    import llvmlite
    import mpmath
    import numba
    import numpy

    sympy = importlib.util.find_spec("sympy")
    release = Path(sympy.origin).with_name("release.py").read_text() if sympy else ""
    return [*(package.__version__ for package in (llvmlite, mpmath, numba, numpy)), release]


def _processor() -> list[str]:
    """What Numba compiles for, and the settings of it that change the code."""
    from llvmlite import binding
    from numba import config

    name = config.CPU_NAME or binding.get_host_cpu_name()
    features = config.CPU_FEATURES
    if features is None:
        features = binding.get_host_cpu_features().flatten()
    settings = (
        "OPT",
        "LOOP_VECTORIZE",
        "SLP_VECTORIZE",
        "ENABLE_AVX",
        "USING_SVML",
        "BOUNDSCHECK",
        "DEBUGINFO_DEFAULT",
    )
    return [name, features, *(f"{s}={getattr(config, s, None)}" for s in settings)]


def folder() -> Path | None:
    """The subfolder of this version, which need not exist."""
    place = root()
    return None if place is None else place / version()


def read(name: str) -> bytes | None:
    """The entry, or None where there is none; one that is not what was written is removed."""
    place = folder()
    if place is None:
        return None
    try:
        seal, _, content = (place / name).read_bytes().partition(b"\n")
    except OSError:
        return None
    if seal == _seal(name, content):
        _note_use(place)
        return content
    forget(name)
    return None


def write(name: str, content: bytes) -> None:
    """Enter the content, whole or not at all; where that cannot be, say so once in a process."""
    place = folder()
    try:
        if place is None:
            raise OSError("the platform names no folder for caches")
        place.mkdir(parents=True, exist_ok=True)
        _evict_once()
        handle, temporary = tempfile.mkstemp(dir=place, suffix=".tmp")
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(_seal(name, content) + b"\n" + content)
            os.replace(temporary, place / name)
        except OSError:
            with suppress(OSError):
                os.unlink(temporary)
            raise
    except OSError as error:
        _say_once(error)


def forget(name: str) -> None:
    """Remove an entry."""
    place = folder()
    if place is not None:
        with suppress(OSError):
            (place / name).unlink()


@contextmanager
def alone(name: str) -> Iterator[None]:
    """Let other processes that are about to make the same entry wait for this one, and then find it.

    The lock is the system's, on an open file: it goes with a process that is killed.  Who has waited for `PATIENCE`, or
    cannot lock, makes the entry as well, which costs time and nothing else.
    """
    place = folder()
    if place is None or (place / name).exists():
        yield
        return
    release = _locked(place / f"{name}.lock", place / name)
    try:
        yield
    finally:
        release()


def _locked(lock: Path, entry: Path) -> Callable[[], None]:
    """What releases the lock, or does nothing where the entry came, the patience ended or nothing can be locked."""
    try:
        import fcntl

        lock.parent.mkdir(parents=True, exist_ok=True)
        stream = lock.open("ab")
    except (ImportError, OSError):
        return lambda: None

    def release() -> None:
        with stream, suppress(OSError):  # whoever waits has it open, and finds the entry
            lock.unlink(missing_ok=True)
            fcntl.flock(stream, fcntl.LOCK_UN)

    until = time.monotonic() + PATIENCE
    while not entry.exists() and time.monotonic() < until:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return release
        except BlockingIOError:
            time.sleep(PAUSE)
        except OSError:  # a file system without locks
            break
    stream.close()
    return lambda: None


@lru_cache(maxsize=8)
def _note_use(place: Path) -> None:
    """Let the subfolder's time be that of its last use, once in a process."""
    with suppress(OSError):
        os.utime(place)


def _seal(name: str, content: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\n" + content).hexdigest().encode()


def _say_once(error: OSError) -> None:
    if not _said:
        _said.append(error)
        _log.warning("nothing is kept in the cache, so that every process compiles anew: %s", error)


# -- its size ----------------------------------------------------------------------------------------------------------


def versions() -> Iterator[Path]:
    """The subfolders of every version."""
    place = root()
    with suppress(OSError):
        yield from (p for p in place.iterdir() if _VERSION.fullmatch(p.name) and p.is_dir())


def size(place: Path) -> tuple[int, int]:
    """(number of entries, bytes) in a subfolder."""
    sizes = [s for _, s, _ in _entries(place)]
    return len(sizes), sum(sizes)


def clear() -> None:
    """Remove every version's entries, and nothing else that stands in the folder."""
    for place in versions():
        shutil.rmtree(place, ignore_errors=True)


def _entries(place: Path) -> list[tuple[float, int, Path]]:
    """(time, bytes, path) of the entries, oldest first; a file may vanish while this looks."""
    found = []
    with suppress(OSError):
        for path in place.iterdir():
            with suppress(OSError):
                stat = path.stat()
                found.append((stat.st_mtime, stat.st_size, path))
    return sorted(found)


def evict() -> None:
    """Bring the folder below `BOUND`, and remove what killed processes left."""
    own = folder()
    others = sorted((p for p in versions() if p != own), key=_used)
    total = 0
    for place in [*others, own] if own else others:
        for time_, bytes_, path in _entries(place):
            if path.suffix in (".tmp", ".lock") and time_ < time.time() - ABANDONED:
                path.unlink(missing_ok=True)
            else:
                total += bytes_
    for place in others:
        if total <= BOUND:
            return
        total -= size(place)[1]
        shutil.rmtree(place, ignore_errors=True)
    for _, bytes_, path in _entries(own) if own else ():
        if total <= BOUND:
            return
        path.unlink(missing_ok=True)
        total -= bytes_


@lru_cache(maxsize=1)
def _evict_once() -> None:
    evict()


def _used(place: Path) -> float:
    """When a process last read or wrote in the subfolder."""
    with suppress(OSError):
        return place.stat().st_mtime
    return 0.0
