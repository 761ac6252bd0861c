"""The cache on disk of generated source text and machine code: one folder, checked when read, and safe to delete.

The folder is $PHASEBENCH_CACHE, or else the platform's folder for caches.  Entries are in a subfolder named by the hash
of what compiles them (Python, the packages that generate and compile, the processor, the overloads in `values`); an
entry's own name has the hash of the code that it is made of (`digest`), so that a stale entry is never found, and one
that is not stale always is.
An entry begins with the hash of its name and content; a truncated or changed one is removed and made again.  It is
written by a rename, so that concurrent writers never leave half of one.
Processes that need the same entry wait for the one that makes it (`hold_lock`).  Where nothing can be written, work
goes on without a cache, after one line of warning.

When all subfolders together exceed `MAX_BYTES` bytes, those of other versions are removed, the longest unused first;
then this version's oldest entries.
"""

from __future__ import annotations

import hashlib
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

from .essence import essence

#: The largest size of the folder, in bytes.
MAX_BYTES = 500_000_000
#: Age in seconds from which a temporary file or a lock counts as left over by a killed process.
STALE_AFTER = 3600
#: Longest time to wait for an entry that another process makes, and the time between two looks, in seconds.
LOCK_TIMEOUT, LOCK_POLL = 60.0, 0.01

#: The files of a folder of machine code: the source that Numba takes it for, and the seal.
SOURCE, SEAL = "source.py", "seal"

#: The folder of the kinds of number, whose operations are overloads.
VALUES = Path(__file__).resolve().parents[1] / "values"
_VERSION = re.compile(r"py\d+-[0-9a-f]{16}")
_log = logging.getLogger("phasebench")
#: The first failure to write in this process, which has been logged.
_logged: list[Exception] = []


def root() -> Path | None:
    """The cache folder that holds the entries of all versions; None if the platform names none."""
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
    """The name of this version's subfolder, which is the hash of what compiles its entries."""
    from importlib import metadata

    packages = [metadata.version(name) for name in ("llvmlite", "mpmath", "numba", "numpy", "sympy")]
    facts = repr([sys.version, platform.machine(), *packages, *_processor_settings(), _overloads()])
    return f"py{sys.version_info[0]}{sys.version_info[1]}-{hashlib.sha256(facts.encode()).hexdigest()[:16]}"


def _overloads() -> str:
    """The hash of the code of `values`: Numba finds overloads there that no function names which compiles to them.

    It is kept in the folder of all versions, by the hash of the files' bytes, so that a process need not parse them.
    """
    texts = [path.read_bytes() for path in sorted(VALUES.glob("*.py"))]
    place = root()
    kept = place and place / f"values-{hashlib.sha256(repr(texts).encode()).hexdigest()[:16]}"
    with suppress(OSError):
        if kept:
            return kept.read_text(encoding="utf-8")
    found = hashlib.sha256(repr([essence(text.decode()) for text in texts]).encode()).hexdigest()[:16]
    with suppress(OSError):
        if kept:
            place.mkdir(parents=True, exist_ok=True)
            _put(kept, found.encode())
    return found


def _processor_settings() -> list[str]:
    """The processor that Numba compiles for, and those of Numba's settings that change the code."""
    from llvmlite import binding
    from numba import config

    name = config.CPU_NAME or binding.get_host_cpu_name()
    features = config.CPU_FEATURES
    if features is None:
        features = binding.get_host_cpu_features().flatten()
    settings = "OPT LOOP_VECTORIZE SLP_VECTORIZE ENABLE_AVX USING_SVML BOUNDSCHECK DEBUGINFO_DEFAULT"
    return [name, features, *(f"{s}={getattr(config, s, None)}" for s in settings.split())]


def folder() -> Path | None:
    """The subfolder of this version, which may not exist yet; None if there is no folder for caches."""
    place = root()
    return None if place is None else place / version()


def read(name: str) -> bytes | None:
    """The content of the cache entry ``name``, or None if there is none; a damaged entry is removed."""
    place = folder()
    if place is None:
        return None
    try:
        seal, _, content = (place / name).read_bytes().partition(b"\n")
    except OSError:
        return None
    if seal == _seal(name, content):
        _note_use(place)
        _note_use(place / name)
        return content
    forget(name)
    return None


def write(name: str, content: bytes) -> None:
    """Store the content as the cache entry ``name``, completely or not at all; the first failure is logged."""
    place = folder()
    try:
        if place is None:
            raise OSError("the platform names no folder for caches")
        place.mkdir(parents=True, exist_ok=True)
        _evict_once()
        _put(place / name, _seal(name, content) + b"\n" + content)
    except OSError as error:
        log_once(error)


def _put(path: Path, content: bytes) -> None:
    """Write a file completely or not at all."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
        os.replace(temporary, path)
    except OSError:
        with suppress(OSError):
            os.unlink(temporary)
        raise


def forget(name: str) -> None:
    """Remove the cache entry ``name``, a file or a folder of machine code, if it exists."""
    place = folder()
    if place is not None:
        _remove(place / name)


def _remove(path: Path) -> None:
    with suppress(OSError):
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink()


# -- machine code ------------------------------------------------------------------------------------------------------


def seal_of(name: str) -> str:
    """The name, in the cache, of the seal of the folder ``name``: a file with the hash of the folder's files."""
    return f"{name}/{SEAL}"


def source_of(name: str) -> tuple[Path | None, bool]:
    """(The empty source file beside which Numba keeps machine code, or None; True if its folder is intact).

    The folder is the entry ``name`` of the cache; it is emptied if damaged.
    """
    place = folder()
    try:
        if place is None:
            raise OSError("the platform names no folder for caches")
        home = place / name
        sealed = _is_sealed(home)
        if sealed:
            _note_use(place)
            _note_use(home)
        else:
            _remove(home)
            home.mkdir(parents=True)
            _evict_once()
            (home / SOURCE).touch()
        return home / SOURCE, sealed
    except OSError as error:
        log_once(error)
        return None, False


def _is_sealed(home: Path) -> bool:
    try:
        return (home / SEAL).read_bytes() == _content(home).encode()
    except OSError:
        return False


def seal(name: str) -> None:
    """Mark a folder of machine code as complete, by a file with its hash."""
    home = folder() / name
    try:
        if not (home / SEAL).exists():
            (home / f"{SEAL}.tmp").write_text(_content(home))
            os.replace(home / f"{SEAL}.tmp", home / SEAL)
    except OSError as error:
        log_once(error)


def _content(home: Path) -> str:
    digest = hashlib.sha256(home.name.encode())
    for path in sorted(p for p in home.glob("**/*") if p.is_file() and not p.name.startswith(SEAL)):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(home).as_posix()} {len(content)} ".encode() + content)
    return digest.hexdigest()


@contextmanager
def hold_lock(name: str) -> Iterator[None]:
    """Hold the lock of a cache entry while making the entry, so that other processes wait for it, and then find it.

    The lock is the operating system's, on an open file, so that it ends with a process that is killed.  A process that
    has waited for `LOCK_TIMEOUT`, or that cannot lock, makes the entry as well; that costs time and nothing else.
    """
    place = folder()
    if place is None or (place / name).exists():
        yield
        return
    release = _acquire_lock(place / f"{name.replace('/', '-')}.lock", place / name)
    try:
        yield
    finally:
        release()


def _acquire_lock(lock: Path, entry: Path) -> Callable[[], None]:
    """Lock the file ``lock``; return the function that unlocks it, which does nothing where the wait was in vain.

    The wait for another process ends if the file ``entry`` appears, which that process makes, or after `LOCK_TIMEOUT`.
    """
    try:
        import fcntl

        lock.parent.mkdir(parents=True, exist_ok=True)
        stream = lock.open("ab")
    except (ImportError, OSError):
        return lambda: None

    def release() -> None:
        with stream, suppress(OSError):  # waiting processes have the file open, and will find the entry
            lock.unlink(missing_ok=True)
            fcntl.flock(stream, fcntl.LOCK_UN)

    until = time.monotonic() + LOCK_TIMEOUT
    while not entry.exists() and time.monotonic() < until:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return release
        except BlockingIOError:
            time.sleep(LOCK_POLL)
        except OSError:  # a file system without locks
            break
    stream.close()
    return lambda: None


@lru_cache(maxsize=4096)
def _note_use(place: Path) -> None:
    """Set a modification time, as the time of the last use, once in a process."""
    with suppress(OSError):
        os.utime(place)


def _seal(name: str, content: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\n" + content).hexdigest().encode()


def log_once(error: Exception) -> None:
    """Log that the cache cannot be written, once in a process."""
    if not _logged:
        _logged.append(error)
        _log.warning("nothing is kept in the cache, so that every process compiles anew: %s", error)


# -- its size ----------------------------------------------------------------------------------------------------------


def versions() -> Iterator[Path]:
    """Iterate over the cache's subfolders, one for each version of the compilers and each kind of processor."""
    place = root()
    with suppress(OSError):
        yield from (p for p in place.iterdir() if _VERSION.fullmatch(p.name) and p.is_dir())


def size(place: Path) -> tuple[int, int]:
    """The number of entries in a subfolder and their size in bytes."""
    sizes = [s for _, s, _ in _entries(place)]
    return len(sizes), sum(sizes)


def clear() -> None:
    """Remove the cache entries of every version, and nothing else in the folder."""
    for place in versions():
        _remove(place.with_name("evicted"))
        _remove(place)


def _entries(place: Path) -> list[tuple[float, int, Path]]:
    """(Modification time, bytes, path) of each entry, oldest first; files that vanish meanwhile are left out."""
    entries = []
    with suppress(OSError):
        for path in place.iterdir():
            with suppress(OSError):
                inside = [p.stat() for p in path.glob("**/*") if p.is_file()] if path.is_dir() else []
                entries.append((path.stat().st_mtime, sum(s.st_size for s in inside or [path.stat()]), path))
    return sorted(entries)


def evict() -> None:
    """Shrink the cache to `MAX_BYTES` bytes, other versions first, and remove what killed processes left."""
    own = folder()
    others = sorted((p for p in versions() if p != own), key=_last_used)
    total = 0
    for place in [*others, own] if own else others:
        for time_, bytes_, path in _entries(place):
            if path.suffix in (".tmp", ".lock") and time_ < time.time() - STALE_AFTER:
                path.unlink(missing_ok=True)
            else:
                total += bytes_
    for place in others:
        if total <= MAX_BYTES:
            return
        total -= size(place)[1]
        shutil.rmtree(place, ignore_errors=True)
    for _, bytes_, path in _entries(own) if own else ():
        if total <= MAX_BYTES:
            return
        _remove(path)
        total -= bytes_


@lru_cache(maxsize=1)
def _evict_once() -> None:
    """Shrink the cache, unless that was done less than `STALE_AFTER` seconds ago: to look at all entries takes long."""
    last = root() / "evicted"
    if last.exists() and last.stat().st_mtime > time.time() - STALE_AFTER:
        return
    evict()
    last.touch()


def _last_used(place: Path) -> float:
    with suppress(OSError):
        return place.stat().st_mtime
    return 0.0
