"""Choice of shots by an optimal design: the poses after which positions are least uncertain.

Theory of operation. Candidates are poses with whitened derivatives J_i (3, Q) of a point there by
all unknowns, or J_i (r, Q) of another kind of observation. After the chosen ones the posterior
covariance is C = (P + Σ J_i'J_i)⁻¹, with the priors' precision P. It depends on poses alone, so
that a plan can be judged before anything is measured.
Minimised is the mean variance of positions over the workspace, tr(B C B'), with derivatives B
without the frame's motion: I-optimality, the quantity that users ask about, where D-optimality
would weigh parameters that move no position.

1. Greedy: add the best candidate, one after the other.
2. Exchange (Cook and Nachtsheim 1980): take each chosen shot away and add the best candidate
   instead, until no shot changes.
"""

from dataclasses import dataclass, field

import numpy as np

from campaigns.arrays import Array

MOST_EXCHANGE_ROUNDS = 3
"""Largest number of rounds of exchange: later ones change little."""


# A shot more or less changes C by a term of rank r, 3 of a point (Woodbury's identity). With
# A = 1 ± J C J'
#     C ← C ∓ C J' A⁻¹ J C          tr(B C B') falls or rises by tr(A⁻¹ J C B' B C J')
# so that all candidates are judged at once from the products J C and J C B', which follow each
# change by a term of that rank as well: no matrix is inverted again for a trial.
@dataclass(eq=False)
class ShotDesign:
    """Shots chosen among candidates, and the posterior covariance after them."""

    jacobians: Array
    """Whitened derivatives J of the candidates by all unknowns, (M, r, Q)."""
    prior: Array
    """Precision P of the unknowns before any shot, (Q, Q), positive definite."""
    judged: Array
    """Derivatives B of the judged positions by all unknowns, (K, 3, Q); from then on a matrix of at
    most Q rows with B'B over the number of positions. Quantities of one or two coordinates at K
    poses are judged alike."""
    chosen: list[int] = field(default_factory=list)
    """Rows of the chosen candidates, in the order of their choice."""

    def __post_init__(self) -> None:
        # only B'B = R'R matters, with B = QR: R has few rows
        rows, count = self.judged.reshape(-1, self.judged.shape[-1]), len(self.judged)
        self.judged = np.linalg.qr(rows, mode="r") / np.sqrt(count)
        self._restart()

    def _restart(self) -> None:
        """Form all products again from the chosen shots, without the rounding of many changes."""
        rows = self.jacobians[self.chosen].reshape(-1, self.jacobians.shape[2])
        self.covariance = np.linalg.inv(self.prior + rows.T @ rows)
        self._products = self.jacobians @ self.covariance  # J C, (M, r, Q)
        self._judged_products = self._products @ self.judged.T  # J C B', (M, r, R)

    @property
    def position_std_mm(self) -> float:
        """Root of the mean variance tr(B C B') of positions over the workspace, mm."""
        spread = self.judged @ self.covariance
        return float(np.sqrt((spread * self.judged).sum()))

    def add_best(self) -> int:
        """Add the candidate that lowers the variance of positions most; return its row."""
        # all A at once, (M, r, r)
        inner = self._products @ self.jacobians.swapaxes(1, 2) + np.eye(self.jacobians.shape[1])
        scaled = np.linalg.solve(inner, self._judged_products)
        gain = (self._judged_products * scaled).sum(axis=(1, 2))
        gain[self.chosen] = -np.inf
        best = int(gain.argmax())
        self._change(best, 1.0)
        self.chosen.append(best)
        return best

    def add_until(self, count: int, std_mm: float | None = None) -> None:
        """Add shots until there are `count` of them, or σ of positions is `std_mm` or less."""
        while len(self.chosen) < count and not (std_mm and self.position_std_mm <= std_mm):
            self.add_best()
        self._restart()

    def exchange(self) -> None:
        """Exchange chosen shots for better candidates until none changes."""
        for _ in range(MOST_EXCHANGE_ROUNDS):
            before = set(self.chosen)
            # a shot that is the best one itself comes back at once
            for shot in list(self.chosen):
                self._change(shot, -1.0)
                self.chosen.remove(shot)
                self.add_best()
            self._restart()
            if set(self.chosen) == before:
                break

    def _change(self, shot: int, sign: float) -> None:
        """Add (+1) or take away (-1) a shot from the covariance and all products."""
        jacobian, product = self.jacobians[shot], self._products[shot]
        inner = np.eye(len(jacobian)) + sign * jacobian @ product.T  # A, (r, r)
        change = np.linalg.solve(inner, product)  # A⁻¹ J C
        self.covariance = self.covariance - sign * product.T @ change
        mixed = sign * (self.jacobians @ product.T)  # J of all candidates · C J'
        self._products -= mixed @ change
        self._judged_products -= mixed @ np.linalg.solve(inner, self._judged_products[shot])
