"""Whose weights gala's RK5 has, "the Dormand-Prince coefficients": Dormand and Prince's, or Cash and Karp's."""

from fractions import Fraction as F

import numpy as np
from gala.integrate.pyintegrators import rk5
from scipy.integrate import RK45  # Dormand & Prince's pair

cash_karp = np.array([F(37, 378), 0, F(250, 621), F(125, 594), 0, F(512, 1771)], dtype=float)
print(f"largest difference of the weights from Cash and Karp's = {np.abs(rk5.C - cash_karp).max():.1e}")
print(f"largest difference of the weights from Dormand and Prince's = {np.abs(rk5.C - RK45.B).max():.1e}")
