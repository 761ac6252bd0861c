"""The command line: ``python -m benchmarks``, installed as ``phasebench``.

Heavy packages load only in the command that needs them.
"""

from __future__ import annotations

import json
import sys
from enum import StrEnum
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from integrators.errors import InvalidInput

app = typer.Typer(
    help="A validation benchmark suite for geometric integrators of Hamiltonian systems.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
out, err = Console(), Console(stderr=True)


class Kind(StrEnum):
    """What can be listed."""

    methods = "methods"
    problems = "problems"
    scenes = "scenes"
    peers = "peers"


def _show(title: str, heads: list[str], rows: list[list[str]]) -> None:
    from rich.table import Table

    table = Table(title=title, header_style="bold", show_lines=False)
    for i, head in enumerate(heads):
        table.add_column(head, no_wrap=i == 0, overflow="fold")
    for row in rows:
        table.add_row(*row)
    (out if out.is_terminal else Console(width=280)).print(table)


@app.command("list")
def list_(kind: Annotated[Kind, typer.Argument(help="What to list.")] = Kind.methods) -> None:
    """List methods, problems, scenes or peers."""
    if kind is Kind.methods:
        from benchmarks import describe

        table = describe.methods()
        heads, rows = list(table[0]), [list(r.values()) for r in table]
    elif kind is Kind.problems:
        from benchmarks.problems import PROBLEMS

        heads = ["problem", "name", "orbits (the first is the default)"]
        rows = [[id, name, ", ".join(orbits)] for id, (_, name, orbits) in PROBLEMS.items()]
    elif kind is Kind.scenes:
        from benchmarks.scenes import SCENES

        heads = ["scene", "problem", "purpose", "t_end", "h"]
        rows = [[s.id, s.problem, s.purpose, f"{s.t_end:g}", ", ".join(f"{h:g}" for h in s.steps)] for s in SCENES]
    else:
        from reference.peers import PEERS

        heads = ["peer", "name", "package", "step", "problems", "license"]
        rows = [
            [
                p.id,
                p.name,
                p.package,
                "adaptive (--tol)" if p.adaptive else "fixed (--h)",
                p.scope,
                p.license,
            ]
            for p in PEERS
        ]
    _show(kind.value, heads, rows)


def _complain(error: InvalidInput) -> None:
    """Print what was wrong with the input; brackets in it are text."""
    from rich.markup import escape

    err.print(f"[bold red]invalid:[/] {escape(str(error))}", highlight=False, soft_wrap=True)


def _numbers(text: str | None, name: str) -> list[float] | None:
    """Comma-separated numbers; fractions such as 1/3 are read as well."""
    if text is None:
        return None
    try:
        return [float(Fraction(x.strip())) if "/" in x else float(x) for x in text.split(",")]
    except (ValueError, ZeroDivisionError):
        raise InvalidInput(f"--{name} is '{text}'; it must be numbers with commas between, such as 0,0.82") from None


def _pairs(items: list[str], option: str) -> dict[str, str]:
    found = {}
    for item in items:
        key, mark, value = item.partition("=")
        if not mark or not key or not value:
            raise InvalidInput(f"{option} {item}: write name=value, such as lam=1/3")
        found[key.strip()] = value.strip()
    return found


def _problem(name: str, values: dict[str, str]):
    from benchmarks.problems import problem

    numbers = {k: _numbers(v, f"set {k}") for k, v in values.items()}
    for k, found in numbers.items():
        if len(found) != 1:
            raise InvalidInput(f"--set {k} is '{values[k]}'; it must be one number")
    return problem(name, **{k: found[0] for k, found in numbers.items()})


def _result(problem, solution, parameters: dict[str, Any]) -> dict[str, Any]:
    """The JSON object of ``integrate``."""
    import numpy as np

    system = problem.system

    def error(expression) -> dict[str, float | None]:
        value = system.observe(expression, solution.q, solution.p)
        good = value[np.isfinite(value)]
        if len(good) < 2:  # nothing but the start is known
            return {"max": None, "end": None}
        return {"max": float(np.abs(good - good[0]).max()), "end": float(good[-1] - good[0])}

    kept = ("steps", "gradient", "hessian", "iterations", "fallbacks")
    return {
        "problem": problem.label,
        "method": solution.method.id,
        "params": parameters,
        "h": solution.h,
        "steps": solution.counts["steps"],
        "t": float(solution.t[-1]),
        "q": [float(x) for x in solution.q[-1]],
        "p": [float(x) for x in solution.p[-1]],
        "energy_error": error(system.H),
        "invariants": {name: error(e) for name, e in problem.invariants.items()},
        "status": solution.status,
        "reason": solution.reason,
        "counts": {k: int(solution.counts.get(k, 0)) for k in kept},
        "seconds": solution.seconds,
    }


@app.command()
def integrate(
    problem: Annotated[str, typer.Argument(help="A problem, or problem:orbit.")],
    method: Annotated[str, typer.Argument(help="A method or a peer.")],
    h: Annotated[
        float | None, typer.Option("--h", help="Step; adjusted so that a whole number of steps ends at --t-end.")
    ] = None,
    t_end: Annotated[float | None, typer.Option(help="End time.")] = None,
    steps: Annotated[int | None, typer.Option(help="Number of steps.")] = None,
    tol: Annotated[float | None, typer.Option(help="Tolerance of an adaptive peer.")] = None,
    param: Annotated[list[str], typer.Option(help="A method's parameter: lam=1/3.")] = [],  # noqa: B006
    set_: Annotated[list[str], typer.Option("--set", help="A problem's parameter: e=0.2.")] = [],  # noqa: B006
    q: Annotated[str | None, typer.Option(help="Initial coordinates: 0,0.82.")] = None,
    p: Annotated[str | None, typer.Option(help="Initial momenta: 0.1,0.")] = None,
    timeout: Annotated[float | None, typer.Option(help="Stop after so many seconds.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Integrate a problem with a method and say how it went; exit code 0 only for status ok."""
    chosen = {}
    try:
        made = _problem(problem, _pairs(set_, "--set"))
        chosen = _pairs(param, "--param")
        result = _integrated(made, method, chosen, h, t_end, steps, tol, _numbers(q, "q"), _numbers(p, "p"), timeout)
    except InvalidInput as error:
        if as_json:
            print(
                json.dumps(
                    {"problem": problem, "method": method, "params": chosen, "status": "invalid", "reason": str(error)}
                )
            )
        else:
            _complain(error)
        raise typer.Exit(2) from None
    if as_json:
        print(json.dumps(result))
    else:
        _print(result)
    raise typer.Exit(0 if result["status"] == "ok" else 1)


def _integrated(made, id, parameters, h, t_end, steps, tol, q, p, timeout) -> dict[str, Any]:
    from integrators.registry import BY_ID
    from integrators.registry import method as method_of
    from reference.peers import BY_ID as PEERS

    if id in PEERS:
        from reference.peers import integrate_peer

        if parameters:
            raise InvalidInput(f"'{id}' has no parameters; it takes --h or --tol")
        solution = integrate_peer(made, id, h=h, tol=tol, t_end=t_end, steps=steps, q0=q, p0=p)
        if solution.status == "ok":
            # The rows above give the invariants along the way; the time is of a run without output.
            bare = integrate_peer(made, id, h=h, tol=tol, t_end=t_end, steps=steps, q0=q, p0=p, save_every=0)
            object.__setattr__(solution, "seconds", bare.seconds)
        return _result(made, solution, {} if tol is None else {"tol": tol})
    if id not in BY_ID:
        from integrators.errors import unknown

        raise unknown("method", id, [*BY_ID, *PEERS])
    if tol is not None:
        raise InvalidInput(f"'{id}' takes a step --h, no tolerance")
    from integrators.driver import integrate as run

    chosen = method_of(id, **parameters)
    common = {"h": h, "t_end": t_end, "steps": steps, "q0": q, "p0": p, "timeout": timeout}
    solution = run(made, chosen, **common)
    if solution.status == "ok":
        bare = run(made, chosen, **common, save_every=0)
        object.__setattr__(solution, "seconds", bare.seconds)
    return _result(made, solution, {k: str(v) for k, v in chosen.parameters.items()})


def _print(result: dict[str, Any]) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table(show_header=False, box=None)
    good = result["status"] == "ok"
    table.add_row("status", f"[{'green' if good else 'bold red'}]{result['status']}[/]")
    if result["reason"]:
        table.add_row("reason", Text(result["reason"]))
    names = ", ".join(f"{k}={v}" for k, v in result["params"].items())
    table.add_row("run", f"{result['method']}{f'({names})' if names else ''} on {result['problem']}")
    table.add_row("time", f"t = {result['t']!r}, {result['steps']} steps of h = {result['h']!r}")
    table.add_row("q", ", ".join(map(repr, result["q"])))
    table.add_row("p", ", ".join(map(repr, result["p"])))
    for name, e in {"energy": result["energy_error"], **result["invariants"]}.items():
        known = e["max"] is not None
        table.add_row(f"{name} error", f"at most {e['max']:.3e}, at the end {e['end']:+.3e}" if known else "unknown")
    table.add_row("counts", ", ".join(f"{k} {v}" for k, v in result["counts"].items()))
    table.add_row("seconds", f"{result['seconds']:.6f} (warm integration alone)")
    out.print(table, highlight=False)


@app.command()
def run(
    scene: Annotated[list[str], typer.Option(help="A scene; all where none is named.")] = [],  # noqa: B006
    method: Annotated[list[str], typer.Option(help="A method; all where none is named.")] = [],  # noqa: B006
    quick: Annotated[bool, typer.Option(help="Fewer steps.")] = False,
    output: Annotated[
        Path, typer.Option(help="Rows, one JSON object a line; a run that was killed goes on there.")
    ] = Path("rows.jsonl"),
) -> None:
    """Sweep methods over scenes into tidy rows, kept on disk as they are measured."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from benchmarks import sweep
    from benchmarks.scenes import BY_ID, SCENES
    from benchmarks.store import Store
    from integrators.errors import unknown
    from integrators.registry import BY_ID as KNOWN

    try:
        for name, known, kind in [(s, BY_ID, "scene") for s in scene] + [(m, KNOWN, "method") for m in method]:
            if name not in known:
                raise unknown(kind, name, known)
        store = Store(output)
        todo = sweep.tasks(
            [s for s in SCENES if not scene or s.id in scene], quick, lambda m: not method or m.id in method
        )
        done = sum(store.get(t.key) is not None for t in todo)
        if done:
            err.print(f"{done} of {len(todo)} rows are in {output} already")
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, console=err) as progress:
            bar = progress.add_task("sweep", total=len(todo), completed=done)

            def told(task, row):
                progress.update(bar, advance=1, description=f"{task.scene}, {row['method']}")

            rows = sweep.run(todo, store, told)
    except InvalidInput as error:
        _complain(error)
        raise typer.Exit(2) from None
    bad: dict[str, int] = {}
    for r in rows:
        bad[r["status"]] = bad.get(r["status"], 0) + 1
    out.print(f"{len(rows)} rows in {output}: " + ", ".join(f"{n} {s}" for s, n in bad.items()))


@app.command()
def report(
    folder: Annotated[Path, typer.Option(help="The folder whose data the report is written from.")] = Path("reports"),
    rows: Annotated[Path | None, typer.Option(help="Rows of `run` to take in first.")] = None,
    figures: Annotated[bool, typer.Option(help="Draw the figures as well.")] = True,
) -> None:
    """Write the report of a folder from the tables in its ``data``."""
    from benchmarks import report as reports
    from benchmarks.results import Results
    from benchmarks.store import Store

    try:
        if rows is not None:
            if not rows.exists():
                raise InvalidInput(f"there is no file {rows}; `phasebench run --output {rows}` makes one")
            measured = [{k: v for k, v in r.items() if k != "key"} for r in Store(rows).rows()]
            if not measured:
                raise InvalidInput(f"{rows} has no rows; `phasebench run --output {rows}` measures some")
            found = Results(folder, quick=any(r.get("tier") == "quick" for r in measured))
            found.add("rows", measured)
            found.write()
        if not (folder / "data").is_dir():
            raise InvalidInput(f"there are no data in {folder}; `pytest benchmarks` or `phasebench run` measures them")
    except InvalidInput as error:
        _complain(error)
        raise typer.Exit(2) from None
    entry = reports.build(folder, progress=lambda line: err.print(line, highlight=False), figures=figures)
    out.print(f"read {entry}")


@app.command()
def cite(
    methods: Annotated[list[str] | None, typer.Argument(help="Methods; at first those that the report used.")] = None,
    folder: Annotated[Path, typer.Option(help="The report's folder.")] = Path("reports"),
) -> None:
    """Print BibTeX for the works behind methods, or behind all that a report used."""
    from benchmarks import bibliography
    from integrators.registry import method as method_of

    try:
        if methods:
            ids = [method_of(m).id for m in methods]
        else:
            ids = bibliography.used(folder)
    except FileNotFoundError:
        _complain(InvalidInput(f"there are no data in {folder}; name methods, or run `pytest benchmarks` first"))
        raise typer.Exit(2) from None
    except InvalidInput as error:
        _complain(error)
        raise typer.Exit(2) from None
    print(bibliography.cited(ids))


def main() -> None:
    """The installed command."""
    app()


if __name__ == "__main__":
    sys.exit(main())
