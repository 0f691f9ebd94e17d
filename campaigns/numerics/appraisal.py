"""How a set of shots stands to every candidate, kept up to date as shots come and go.

Adding or taking away a measurement changes the covariance by a matrix of rank k (Woodbury); what
it would do to each candidate follows from one product of that thin matrix with all rows, without
touching the P x P covariance again for any of them.
"""

from dataclasses import dataclass

import numpy as np

from campaigns.numerics.candidates import Candidates
from campaigns.numerics.geometry import Array

ADD, REMOVE = 1.0, -1.0


@dataclass(frozen=True, slots=True, eq=False)
class Appraisal:
    """What is known, and what each candidate would make of it."""

    covariance: Array
    """C of scaled unknowns, (P, P)."""
    spread: Array
    """J C Jᵀ of each candidate's rows J, (k, k, M)."""
    effect: Array
    """J C W C Jᵀ of each candidate's rows J, (k, k, M)."""


@dataclass(frozen=True, slots=True, eq=False)
class Appraiser:
    """All candidates' rows in the order that makes products fast, and the weight W (P, P)."""

    rows: Array
    """(M, k, P)"""
    columns: Array
    """The same, (P, k, M)."""
    weight: Array

    @classmethod
    def of(cls, candidates: Candidates, weight: Array) -> "Appraiser":
        """For candidates and a weight."""
        columns = np.ascontiguousarray(candidates.rows.transpose(2, 1, 0))
        return cls(candidates.rows, columns, weight)

    def appraise(self, covariance: Array) -> Appraisal:
        """From nothing but the covariance."""
        weighted = covariance @ self.weight @ covariance
        return Appraisal(covariance, self._seen(covariance), self._seen(weighted))

    def added(self, known: Appraisal, which: int) -> Appraisal:
        """With a candidate taken in."""
        return self._changed(known, which, ADD)

    def removed(self, known: Appraisal, which: int) -> Appraisal:
        """Without one that had been taken in."""
        return self._changed(known, which, REMOVE)

    def covariance_with(self, known: Appraisal, which: int) -> Array:
        """The covariance if a candidate were taken in, (P, P)."""
        turned, middle = self._woodbury(known, which, ADD)
        return np.asarray(known.covariance - turned @ middle @ turned.T)

    def _seen(self, matrix: Array) -> Array:
        """J X Jᵀ of each candidate, (k, k, M)."""
        size, k, count = self.columns.shape
        turned = (matrix @ self.columns.reshape(size, -1)).reshape(size, k, count)
        return np.asarray(np.einsum("pam,pbm->abm", turned, self.columns))

    def _woodbury(self, known: Appraisal, which: int, sign: float) -> tuple[Array, Array]:
        """V and K with C ∓ J'ᵀJ' giving C - V K Vᵀ, (P, k) and (k, k)."""
        rows = self.rows[which]
        turned = known.covariance @ rows.T
        return turned, sign * np.linalg.inv(np.eye(len(rows)) + sign * rows @ turned)

    def _changed(self, known: Appraisal, which: int, sign: float) -> Appraisal:
        turned, middle = self._woodbury(known, which, sign)
        # C W C changes by -(V K Rᵀ + R K Vᵀ) with R = C W V - V K (Vᵀ W V) / 2
        weighted = self.weight @ turned
        other = known.covariance @ weighted - 0.5 * turned @ (middle @ (turned.T @ weighted))
        thin = np.hstack([turned, other])
        size, k, count = self.columns.shape
        seen = (thin.T @ self.columns.reshape(size, -1)).reshape(2, k, k, count)
        by_turned, by_other = seen
        halves = np.tensordot(middle, by_turned, axes=1)
        change = np.einsum("iam,ibm->abm", halves, by_other)
        return Appraisal(
            known.covariance - turned @ middle @ turned.T,
            known.spread - np.einsum("iam,ibm->abm", halves, by_turned),
            known.effect - change - change.transpose(1, 0, 2),
        )
