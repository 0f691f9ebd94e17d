"""Choice of shots: those after which the positions of the robot are known best.

After shots with whitened derivatives J_i (3, Q) the posterior covariance is C = (P + Σ J'J)⁻¹, with
the priors' precision P. What is minimised is the mean variance of positions over the workspace,
tr(B C B'), with derivatives B without the frame's motion. A shot added to C
lowers it by tr(A⁻¹ J C B'B C J'), A = 1 + J C J', a shot taken away raises it by the same with
A = 1 - J C J'. The products J C and J C B' of all candidates follow each
change by a term of rank 3.

1. Greedy: add the best candidate, one after the other.
2. Exchange: take each chosen shot away and add the best candidate instead, until none changes.

Greedy choice alone comes within 10 % of the best σ known, exchange within 5 %.
"""

from dataclasses import dataclass, field

import numpy as np

from campaigns.arrays import Array

EXCHANGE_ROUNDS = 3
"""Rounds of exchange at most: later ones change little."""


@dataclass(eq=False)
class ShotDesign:
    """Shots chosen among candidates, and what they make known."""

    jacobians: Array
    """Whitened derivatives of the candidates by all unknowns, (M, 3, Q)."""
    prior: Array
    """Precision of the unknowns before any shot, (Q, Q), positive definite."""
    judged: Array
    """Derivatives of the judged positions by all unknowns, (K, Q)."""
    chosen: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.judged = np.linalg.qr(self.judged, mode="r") / np.sqrt(len(self.judged) / 3.0)
        self._restart()

    def _restart(self) -> None:
        """Form all products again from what is chosen: rounding of many changes is left behind."""
        rows = self.jacobians[self.chosen].reshape(-1, self.jacobians.shape[2])
        self.covariance = np.linalg.inv(self.prior + rows.T @ rows)
        self._products = self.jacobians @ self.covariance
        self._judged = self._products @ self.judged.T

    @property
    def position_std_mm(self) -> float:
        """Root of the mean variance of positions over the workspace, mm."""
        spread = self.judged @ self.covariance
        return float(np.sqrt((spread * self.judged).sum()))

    def add_best(self) -> int:
        """Add the candidate that lowers the variance of positions most; return it."""
        inner = self._products @ self.jacobians.swapaxes(1, 2) + np.eye(3)
        gain = (self._judged * np.linalg.solve(inner, self._judged)).sum(axis=(1, 2))
        gain[self.chosen] = -np.inf
        best = int(gain.argmax())
        self._change(best, 1.0)
        self.chosen.append(best)
        return best

    def add_until(self, count: int, std_mm: float | None = None) -> None:
        """Add shots until there are `count` of them, or positions are known to `std_mm`."""
        while len(self.chosen) < count and not (std_mm and self.position_std_mm <= std_mm):
            self.add_best()
        self._restart()

    def exchange(self) -> None:
        """Exchange chosen shots for better candidates until none changes."""
        for _ in range(EXCHANGE_ROUNDS):
            before = set(self.chosen)
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
        inner = np.eye(3) + sign * jacobian @ product.T  # A of the module's text
        mixed = sign * (self.jacobians @ product.T)
        change = np.linalg.solve(inner, product)
        self.covariance = self.covariance - sign * product.T @ change
        self._products -= mixed @ change
        self._judged -= mixed @ np.linalg.solve(inner, self._judged[shot])
