"""Code for peers in JAX: double precision, expressions as JAX functions, a compiled loop over steps that saves rows."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .record import Run, Task

if TYPE_CHECKING:
    import jax
    import sympy as sp

#: Rows per call of the compiled loop; fixed, since the compiled code depends on it.
ROWS = 256
#: What a peer's time includes, for its record.
COST = f"a compiled JAX loop; the time includes its dispatch and the copying of rows, {ROWS} a call"


@contextlib.contextmanager
def double_precision() -> Iterator[None]:
    """A context that uses JAX in double precision on the CPU, in this thread only."""
    import jax

    switch = getattr(jax, "enable_x64", None)
    if not callable(switch):  # older versions of JAX
        from jax.experimental import enable_x64 as switch
    with switch(True), jax.default_device(jax.local_devices(backend="cpu")[0]):
        yield


def jax_function(variables: Sequence[Sequence[sp.Symbol]], expressions: Sequence[sp.Expr]) -> Callable[..., jax.Array]:
    """A function from values of the variables (one or two arrays) to a JAX array of the expressions."""
    import jax.numpy as jnp
    import sympy as sp

    evaluate = sp.lambdify(variables, list(expressions), modules="jax", cse=True)
    return lambda *values: jnp.array(evaluate(*values))


class Loop:
    """A compiled loop over steps of a package's method on a system of d degrees of freedom; `rows` integrates by it.

    ``begin(y, h)`` returns what the method carries from step to step at the start, y = (q, p), array (2 d,);
    ``step(number of steps taken before, h, carried)`` returns (carried after this step, True if the step failed), and
    ``state(carried)`` the state (q, p).  JAX can compile all three.
    """

    def __init__(self, d: int, begin: Callable, step: Callable, state: Callable) -> None:
        import jax
        import jax.numpy as jnp

        def loop(
            carried: Any, h: jax.Array, first: jax.Array, end: jax.Array, index: jax.Array
        ) -> tuple[jax.Array, Any, jax.Array]:
            """Take the steps from ``first`` to ``end``: (rows, what the method carries, first step that failed or -1).

            The rows, array (ROWS, 2 d), are the states (q, p) after the steps with the numbers ``index``.
            """

            def take(k: jax.Array, given: tuple[Any, ...]) -> tuple[Any, ...]:
                carried, rows, row, failed = given
                carried, wrong = step(k, h, carried)
                wanted = index[row] == k + 1
                rows = rows.at[row].set(jnp.where(wanted, state(carried), rows[row]))
                failed = jnp.where((failed < 0) & wrong, k + 1, failed)
                return carried, rows, row + wanted, failed

            given = carried, jnp.zeros((ROWS, 2 * d)), jnp.array(0), jnp.array(-1)
            carried, rows, _, failed = jax.lax.fori_loop(first, end, take, given)
            return rows, carried, failed

        self._begin, self._loop = jax.jit(begin), jax.jit(loop)
        for _ in range(2):  # what the loop returns may cause a second compilation
            self.rows(np.full(2 * d, 0.5), 1e-3, np.arange(1, ROWS + 2))

    def rows(self, y: np.ndarray, h: float, numbers: np.ndarray) -> tuple[np.ndarray, int]:
        """Integrate from y = (q, p) with step h: (states (q, p), array (n, 2 d); the step that failed, or -1).

        The states are those after the steps with these ``numbers``; those after a failed step are left out.
        """
        h, rows, begin = np.float64(h), [], 0
        carried = self._begin(y, h)
        for i in range(0, len(numbers), ROWS):
            part = numbers[i : i + ROWS]
            padded = np.full(ROWS, -1)
            padded[: len(part)] = part
            reached, carried, failed = self._loop(carried, h, begin, int(part[-1]), padded)
            failed, begin = int(failed), int(part[-1])
            rows.append(np.asarray(reached)[: len(part) if failed < 0 else int((part < failed).sum())])
            if failed >= 0:
                return np.vstack(rows), failed
        return np.vstack(rows), -1


def run_loop(loop: Callable[[], Loop], task: Task, gradients: int = 0) -> Run:
    """Run a task by the compiled loop that ``loop()`` returns; its compilation is not timed.

    ``gradients`` is the number of gradient evaluations in a step.
    """
    y = task.state
    with double_precision():
        compiled = loop()
        began = time.perf_counter()
        rows, failed = compiled.rows(y, task.h, np.asarray(task.numbers[1:]))
        seconds = time.perf_counter() - began
    failure = f"its equations were not solved in step {failed}" if failed > 0 else None
    return Run.of_states(np.vstack([y, rows]), task.steps, gradients * task.steps, seconds, failure)
