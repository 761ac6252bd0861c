"""`TabularResult`: a result that prints as a table and converts to a pandas DataFrame."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd


class TabularResult(ABC):
    """Base class of a result that prints as a table; indexing, iteration, ``len`` are of its `to_frame`."""

    @abstractmethod
    def to_frame(self) -> pd.DataFrame:
        """Return the table's rows as a pandas DataFrame."""

    def _heading(self) -> list[str]:
        return []

    def _printed(self) -> pd.DataFrame:
        return self.to_frame()

    def __repr__(self) -> str:
        return "\n".join([*self._heading(), self._printed().to_string(index=False)])

    def _repr_html_(self) -> str:
        heading = "".join(f"<p>{escape(line)}</p>" for line in self._heading())
        return heading + self._printed().to_html(index=False)

    def __getitem__(self, key: Any) -> Any:
        return self.to_frame()[key]

    def __len__(self) -> int:
        return len(self.to_frame())

    def __iter__(self) -> Iterator[Any]:
        return iter(self.to_frame())

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            # Until 1.0 results were DataFrames: what one has goes on working for a release.
            if name.startswith("_"):
                raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")
            frame = self.to_frame()
            if not hasattr(frame, name):
                raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")
            message = f"{type(self).__name__} is no DataFrame any more: write .to_frame().{name}"
            warnings.warn(message, DeprecationWarning, stacklevel=2)
            return getattr(frame, name)
