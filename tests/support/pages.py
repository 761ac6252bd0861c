"""The committed reports."""

from __future__ import annotations

from pathlib import Path

#: The folder of the committed reports.
REPORTS = Path(__file__).resolve().parents[2] / "reports"
