"""Write ``polished.json``, the coefficients of published tables refined so that they satisfy the order conditions.

The tables that are new or were edited are refined, and those that are named as arguments; other entries are kept.
"""

from __future__ import annotations

import json
import sys

from phasebench.integrators.coefficients import BY_NAME, POLISHED, read_polished, table
from phasebench.integrators.coefficients.polish import entry


def main(names: list[str]) -> None:
    """Polish the tables that are new, edited or in ``names``; write the file; print residuals before and after."""
    again, kept, data = {table(name).name for name in names}, read_polished(), {}
    for t in BY_NAME.values():
        if t.printed:
            continue
        data[t.name] = kept.get(t.name, {})
        if t.name in again or data[t.name].get("published") != t.digest:
            data[t.name] = entry(t)
            print(f"{t.name}: {data[t.name]['residual_before']} -> {data[t.name]['residual_after']}", flush=True)
    POLISHED.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
