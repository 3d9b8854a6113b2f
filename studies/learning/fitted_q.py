# SPDX-License-Identifier: Apache-2.0

"""Fitted Q iteration (Ernst, Geurts and Wehenkel, 2005) with scikit-learn's regressors."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .worlds import Transitions


def _extra_trees(seed: int):
    from sklearn.ensemble import ExtraTreesRegressor

    return ExtraTreesRegressor(25, min_samples_leaf=5, random_state=seed)


def _nearest_neighbours(seed: int):
    from sklearn.neighbors import KNeighborsRegressor

    # Its distances do not depend on the number of threads; many neighbours are equally near.
    return KNeighborsRegressor(5, algorithm='kd_tree')


def _mlp(seed: int):
    from sklearn.neural_network import MLPRegressor

    # Each iteration goes on from the weights of the last. For so few samples a quasi-Newton method.
    return MLPRegressor(
        hidden_layer_sizes=(32,), solver='lbfgs', alpha=0.01, max_iter=100, warm_start=True,
        random_state=seed,
    )  # fmt: skip


#: By the name that tables show.
REGRESSORS: dict[str, Callable[[int], object]] = {
    'extra_trees': _extra_trees,
    'nearest': _nearest_neighbours,
    'mlp': _mlp,
}


class FittedQ:
    """The greedy policy of action values fitted to transitions, a regressor an action.

    Parameters
    ----------
    transitions : Transitions
    channels : sequence of int
        The channels that it may see; they are standardised.
    num_actions : int
    regressor : str
        One of `REGRESSORS`.
    gamma : float
        Discount factor.
    num_iterations : int
        As many steps ahead are looked at.
    seed : int
        Of the regressors.

    Raises
    ------
    ValueError
        If an action was never taken: nothing can be said of it.

    """

    def __init__(
        self,
        transitions: Transitions,
        channels: Sequence[int],
        num_actions: int,
        regressor: str,
        *,
        gamma: float = 0.95,
        num_iterations: int = 20,
        seed: int = 0,
    ):
        missing = set(range(num_actions)) - set(transitions.actions.tolist())
        if missing:
            raise ValueError(
                f'action {min(missing)} was never taken in {len(transitions.actions)} transitions; '
                'expected each of them at least once: collect more episodes'
            )
        self._channels = list(channels)
        own = transitions.states[:, self._channels]
        self._mean = own.mean(axis=0)
        self._scale = np.where(own.std(axis=0) > 0, own.std(axis=0), 1.0)
        self._models = [REGRESSORS[regressor](seed) for _ in range(num_actions)]
        inputs, reached = self._scaled(transitions.states), self._scaled(transitions.next_states)
        targets = transitions.rewards
        # In units of the largest reward: a network wants values of about 1.
        unit = max(float(np.abs(targets).max()), 1e-12)
        for _ in range(num_iterations):
            for action, model in enumerate(self._models):
                chosen = transitions.actions == action
                model.fit(inputs[chosen], targets[chosen] / unit)
            best = unit * self._values(reached).max(axis=1)
            targets = transitions.rewards + gamma * best * ~transitions.terminated

    def act(self, states: np.ndarray) -> np.ndarray:
        """Return the best action in each state, shape (n, v) to (n,)."""
        return self._values(self._scaled(states)).argmax(axis=1)

    def _scaled(self, states: np.ndarray) -> np.ndarray:
        return (states[:, self._channels] - self._mean) / self._scale

    def _values(self, inputs: np.ndarray) -> np.ndarray:
        return np.column_stack([model.predict(inputs) for model in self._models])
