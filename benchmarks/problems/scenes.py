"""SCENES: those of every problem's module, the order scenes first.

A scene stands in the module of its problem: what is integrated, how far and with which steps, and how far a stored
number may move.
"""

from __future__ import annotations

import importlib

from . import PROBLEMS
from .base import DRIFT, ORDER, Scene


def _stated() -> list[Scene]:
    """The scenes as the modules state them, in the order of the problems."""
    modules = (importlib.import_module(f".{module}", __package__) for module, _, _ in PROBLEMS.values())
    return [scene for module in modules for scene in getattr(module, "SCENES", ())]


SCENES: tuple[Scene, ...] = tuple(sorted(_stated(), key=lambda scene: scene.purpose != ORDER))
BY_ID = {s.id: s for s in SCENES}

__all__ = ["BY_ID", "DRIFT", "ORDER", "SCENES", "Scene"]
