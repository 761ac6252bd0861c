"""What a page is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Page:
    """A page of the report.

    Attributes
    ----------
    id, title, question : its file name, its heading, what a reader learns there
    tables : the tables that it is written from
    write : (data, folder of figures) -> (sentences of verdict, body), or None where its first table is missing
    """

    id: str
    title: str
    question: str
    tables: tuple[str, ...]
    write: Callable[[Callable, Path], tuple[list[str], str] | None]
