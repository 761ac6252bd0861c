"""SCENES: the scenes that the modules of all problems define, those for orders of convergence first.

A scene is defined in the module of its problem: what is integrated, to which time, with which steps, and by how much an
error may differ from the stored one.
"""

from __future__ import annotations

import importlib

from . import PROBLEMS
from .base import DRIFT, ORDER, Scene


def _all_scenes() -> list[Scene]:
    modules = (importlib.import_module(f".{module}", __package__) for module, _, _ in PROBLEMS.values())
    return [scene for module in modules for scene in getattr(module, "SCENES", ())]


SCENES: tuple[Scene, ...] = tuple(sorted(_all_scenes(), key=lambda scene: scene.purpose != ORDER))
BY_ID = {s.id: s for s in SCENES}

__all__ = ["BY_ID", "DRIFT", "ORDER", "SCENES", "Scene"]
