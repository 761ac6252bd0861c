"""The packages of phasebench/, with the folders that its links name where a checkout has no symbolic links."""

from pathlib import Path

from setuptools import find_namespace_packages, setup

#: Without links (Windows' default) these are small files, and the folders stand beside phasebench/ only.
ROOMS = [room for room in ("benchmarks", "integrators", "reference") if not Path("phasebench", room).is_dir()]


def packages(folder: str, **chosen: list[str]) -> list[str]:
    """The packages below a folder; folders of data count."""
    return find_namespace_packages(folder, exclude=["*__pycache__"], **chosen)


setup(
    packages=[
        *packages(".", include=["phasebench*"]),
        *(".".join(["phasebench", room, *sub]) for room in ROOMS for sub in [(), *((p,) for p in packages(room))]),
    ],
    # With links an editable install is a path, which type checkers and editors follow.
    package_dir={"": "."} | {f"phasebench.{room}": room for room in ROOMS},
)
