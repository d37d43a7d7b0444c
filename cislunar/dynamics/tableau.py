"""Coefficients of the two Runge-Kutta pairs of Dormand and Prince.

They are Dormand-Prince 5(4), the propagator of Paul & Fan (table 1), and DOP853, as in
`scipy.integrate.RK45` and `scipy.integrate.DOP853`. Row s of `A5` and `A8` belongs to stage s, at
the node `C5[s]` or `C8[s]` of the step. The row after the last stage is the end of the step, whose
slope enters the error estimate and the next step.
"""

import numpy as np
from scipy.integrate import DOP853, RK45


def _first(a: np.ndarray) -> np.ndarray:
    """First nonzero column after column 0, for each row; the columns between are zero."""
    return np.array([1 + np.argmax(np.append(row[1:], 1.0) != 0.0) for row in a])


STAGES5 = 6
A5 = np.zeros((7, 7))
A5[:6, :5] = RK45.A
A5[6, :6] = RK45.B
C5 = np.append(RK45.C, 1.0)
FIRST5 = _first(A5)
ERROR5 = np.ascontiguousarray(RK45.E)
DENSE5 = np.ascontiguousarray(RK45.P)

STAGES8 = 12
A8 = np.zeros((16, 16))
"""Rows 13 to 15 are further stages of the continuous extension."""
A8[:12, :12] = DOP853.A
A8[12, :12] = DOP853.B
A8[13:] = DOP853.A_EXTRA
C8 = np.concatenate([DOP853.C, [1.0], DOP853.C_EXTRA])
FIRST8 = _first(A8)
ERROR8_3 = np.ascontiguousarray(DOP853.E3)
ERROR8_5 = np.ascontiguousarray(DOP853.E5)
DENSE8 = np.ascontiguousarray(DOP853.D)

PAIR5 = A5, C5, FIRST5, STAGES5
PAIR8 = A8, C8, FIRST8, STAGES8
"""Coefficients, nodes, first nonzero columns and number of stages of each pair."""
