# SPDX-License-Identifier: Apache-2.0

"""What to select sensors for: the return, a decision, or the action.

`return`
    The paper's question: what does the return of the recorded policy depend on, given the action?
`decision`
    What does a controller need if it is to be learned or changed? The sensors on which the reward
    depends given the action, the sensors that predict these at the next step, and so on. They make
    the state Markov (the recursion of Castelletti, Galelli, Restelli & Soncini-Sessa, Tree-based
    feature selection for dimensionality reduction of large-scale control systems, 2011).
`action`
    What does the recorded controller use? This needs no reward.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from operator import or_
from typing import NamedTuple

import numpy as np

from .chance import combined_pvalue, combined_pvalues
from .effect import Effect
from .evidence import ConditionalTest
from .samples import Samples

TARGETS = RETURN, DECISION, ACTION = ('return', 'decision', 'action')
#: Why a decision needs a sensor, if not because it 'predicts NAME'.
REWARD = 'reward'


class Contribution(NamedTuple):
    """What a sensor adds to the prediction of a variable of the target, step by step.

    Attributes
    ----------
    variable : str
        `RETURN`, `REWARD`, 'predicts NAME' or the name of an action.
    episodes, steps : numpy.ndarray of int, shape (N,)
    values : numpy.ndarray, shape (N,)
        In standard deviations of the variable. Their mean square is about the share of its variance
        that the sensor adds.

    """

    variable: str
    episodes: np.ndarray
    steps: np.ndarray
    values: np.ndarray


class TargetTest:
    """Test channels given others for one of `TARGETS`, which may consist of several variables.

    Parameters
    ----------
    samples : Samples
    target : str
        One of `TARGETS`.
    names : sequence of str
        Names of the channels.
    action_names : sequence of str
    gamma : float
        Discount factor of the return.
    options
        As of `ConditionalTest`.

    """

    def __init__(
        self,
        samples: Samples,
        target: str,
        names: Sequence[str],
        action_names: Sequence[str],
        gamma: float,
        **options,
    ):
        self._samples = [samples]
        if target == RETURN:
            test = ConditionalTest(samples, {RETURN: samples.returns}, discount=gamma, **options)
            self._tests = [test]
        elif target == ACTION:
            actions = dict(zip(action_names, samples.actions.T, strict=True))
            self._tests = [ConditionalTest(samples.without_actions(), actions, **options)]
        else:
            self._tests = [ConditionalTest(samples, {REWARD: samples.rewards}, **options)]
            before, after = samples.transitions()
            if len(after):  # Episodes of a single step have no next one.
                self._samples.append(before)
                predicted = {f'predicts {n}': of_n for n, of_n in zip(names, after.T, strict=True)}
                self._tests.append(ConditionalTest(before, predicted, of_given=True, **options))

    def __call__(self, candidates: Sequence[Sequence[int]], given: Sequence[int]) -> np.ndarray:
        """Return the p-value of each candidate set of channels given others: shape (C,).

        It combines all variables of the target, and is not corrected for the number of candidates.
        """
        of_candidates = self._of_all('pvalues', candidates, given)
        return np.array([combined_pvalue(list(of.values())) for of in of_candidates])

    def why(self, candidate: Sequence[int], given: Sequence[int]) -> str:
        """Return the variable with the strongest evidence for a candidate; '' without variables."""
        (pvalues,) = self._of_all('pvalues', [candidate], given)
        return min(pvalues, key=pvalues.__getitem__, default='')

    def effects(self, candidates: Sequence[Sequence[int]], given: Sequence[int]) -> list[Effect]:
        """Return what each candidate adds to the variable with the greatest upper bound."""
        none = Effect(0.0, 0.0)
        return [
            max(of.values(), key=lambda effect: effect.upper_bound, default=none)
            for of in self._of_all('effects', candidates, given)
        ]

    def added(self, candidate: Sequence[int], given: Sequence[int]) -> Contribution:
        """Return what a candidate adds to the prediction of the variable to which it adds most."""
        parts = []
        for samples, test in zip(self._samples, self._tests, strict=True):
            at = samples.owner, samples.step
            added = test.added(candidate, given)
            parts += [Contribution(name, *at, values) for name, values in added.items()]
        none = Contribution('', np.empty(0, int), np.empty(0, int), np.empty(0))
        return max(parts, key=lambda part: float(part.values.var()), default=none)

    def pair_pvalues(self, channels: Sequence[int], given: Sequence[int]) -> np.ndarray:
        """Return the p-values of products of two channels: shape (k, k), 1 but above the diagonal.

        They combine all variables of the target, and are not corrected for the number of pairs.
        """
        of_tests = [test.pair_pvalues(channels, given) for test in self._tests]
        size = len(channels)
        found = [of_name for of_test in of_tests for of_name in of_test.values()]
        return combined_pvalues(np.reshape(found, (-1, size, size)))

    def pair_bounds(self, channels: Sequence[int], given: Sequence[int]) -> np.ndarray:
        """Return upper bounds of what products of two channels add: shape (k, k)."""
        return np.max([test.pair_bounds(channels, given) for test in self._tests], axis=0)

    def predicted_shares(self, given: Sequence[int]) -> dict[str, float]:
        """Return the share of the variance of return, reward or each action that channels predict.

        Variables that do not vary are left out.
        """
        return self._tests[0].predicted_shares(given)

    def predicted_share(self, given: Sequence[int]) -> float:
        """Return the mean of these shares; 0 of none."""
        shares = self.predicted_shares(given)
        return sum(shares.values()) / max(len(shares), 1)

    def _of_all(self, what: str, candidates, given) -> list[dict]:
        """Return the results of the tests for each candidate, by the names of the variables."""
        of_tests = [getattr(test, what)(candidates, given) for test in self._tests]
        return [reduce(or_, of_candidate) for of_candidate in zip(*of_tests, strict=True)]
