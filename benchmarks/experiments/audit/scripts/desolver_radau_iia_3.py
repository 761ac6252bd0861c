"""desolver's RadauIIA3: does each row of its table sum to its node, and which order has the table by itself?"""

import desolver as de
import numpy as np

table, weights = de.integrators.RadauIIA3.tableau_intermediate, de.integrators.RadauIIA3.tableau_final[0, 1:]


def end(n, span=3.0, f=lambda y: np.array([y[1], -np.sin(y[0])])):
    y, h = np.array([1.0, 0.5]), span / n
    for _ in range(n):
        k = np.tile(f(y), (2, 1))
        for _ in range(60):  # the stages by fixed-point iteration
            k = np.array([f(y + h * row[1:] @ k) for row in table])
        y = y + h * weights @ k
    return y


print(f"last node = {table[1, 0]:.4f}")
print(f"sum of its row = {table[1, 1:].sum():.4f}")
order = np.log2(np.abs(end(100) - end(200)).max() / np.abs(end(200) - end(400)).max())
print(f"order, __order__ {de.integrators.RadauIIA3.__order__:.0f} = {order:.2f}")
