"""The held-out objective of LSMI over a grid of widths and regularisations: the fast path.

J of Equation (7) of Hachiya & Sugiyama (2010), for one time step and many channel subsets.
What makes it fast, and why each is exact:

- A Gaussian of (eta, z) is a Gaussian of eta times one of z, so the double sums over pairs of
  samples are products of single sums: H = (K_eta' K_eta) * (K_z' K_z) / M^2, elementwise.
- The Gram matrices of the folds add up to that of all samples, and training on all folds but
  one subtracts that one.
- All subsets share the returns, and the squared distances of the channels they have in common.
- Samples with the same (eta, z) carry the same Gaussian. Their coefficients are equal, so one
  Gaussian scaled by the root of their number stands for all of them: H, h and the penalty
  on the coefficients stay what they were.
- All regularisations of one width and fold share a Krylov space; see `shifted_systems`.
- Where no Gaussian of z reaches from one fold into another, the model is 0 on what is held out,
  and so is J, to far below rounding.

In float32 the same is done as a screening, with Krylov spaces that end earlier. Its errors are far
below `TOLERANCE`; whatever it leaves undecided is to be evaluated again in float64.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, groupby, repeat

import numpy as np
from scipy.spatial.distance import cdist

from .samples import StepSamples
from .shifted_systems import ShiftedSystems
from .workspace import Workspace

#: Values of J in float32 that differ by less than this are undecided. The greatest error seen
#: near the least J is a fifth of it.
TOLERANCE = 2.5e-4
#: Residual of the systems, relative to h.
_RTOL = {np.float32: 1e-5, np.float64: 1e-11}
#: Gaussians below exp(-this) count as 0; divided by the square of any sensible regularisation they
#: still do.
_ISOLATED = 60.0
#: Greatest number of entries in one stack of matrices: larger ones fall out of the cache.
_STACK_ENTRIES = 500_000


class HeldOutObjective:
    """J of Equation (7), averaged over the held-out folds, of the channel subsets of one step.

    Parameters
    ----------
    step : StepSamples
        M samples in F folds, B of them centres.
    subsets : sequence of C sequences of int
        The channels of each candidate feature set.
    regularizations : numpy.ndarray, shape (L,)
        The grid of lambda.
    dtype : {numpy.float32, numpy.float64}

    """

    def __init__(
        self,
        step: StepSamples,
        subsets: Sequence[Sequence[int]],
        regularizations: np.ndarray,
        dtype: type,
    ):
        order = np.argsort(step.folds, kind='stable')
        folds = step.folds[order]
        returns, states = step.returns[order], step.states[order]
        self._regularizations = regularizations
        self._dtype = dtype
        self._workspace = Workspace()
        starts = np.flatnonzero(np.diff(folds, prepend=-1))
        self._folds = [slice(a, b) for a, b in zip(starts, [*starts[1:], len(folds)], strict=True)]
        self._indicator = (folds[:, None] == np.unique(folds)).astype(dtype)
        self._sizes = self._indicator.sum(axis=0)[:, None, None, None]

        centers = np.argsort(order)[step.centers]
        common = [c for c in subsets[0] if all(c in subset for subset in subsets)]
        own = [[c for c in subset if c not in common] for subset in subsets]
        self._eta_distances = cdist(returns[centers, None], returns[:, None], 'sqeuclidean')
        shared = cdist(states[centers][:, common], states[:, common], 'sqeuclidean')
        columns, counts = _merged_centers(returns[centers], states[centers], common, own)
        #: Gaussians of each candidate, None for all the centres; how many each stands for.
        self._columns = columns
        self._scale = None if counts is None else np.sqrt(counts).astype(dtype)[:, :, None]
        size = len(centers) if columns is None else columns.shape[1]
        shape = (len(subsets), size, len(returns))
        self._z_distances = np.empty(shape, dtype)
        self._isolation = np.empty(len(subsets))
        is_other_fold = folds[centers][:, None] != folds
        for i, channels in enumerate(own):
            chosen = states[:, channels]
            distances = shared + cdist(chosen[centers], chosen, 'sqeuclidean')
            self._isolation[i] = distances[is_other_fold].min()
            self._z_distances[i] = distances if columns is None else distances[columns[i]]

    def evaluate(self, which: np.ndarray, widths: np.ndarray) -> np.ndarray:
        """Return J of candidates at widths of the grid, for all lambdas.

        Parameters
        ----------
        which : numpy.ndarray of bool, shape (C, W)
            What to evaluate.
        widths : numpy.ndarray, shape (W,)

        Returns
        -------
        numpy.ndarray of float64, shape (C, W, L)
            0 where `which` is False.

        """
        objective = np.zeros((*which.shape, len(self._regularizations)))
        reaches = self._isolation[:, None] <= 2 * _ISOLATED * widths**2
        # Ordered by width, so that systems that are solved together are alike.
        index, candidates = np.nonzero((which & reaches).T)
        for pairs in self._batches(len(index)):
            objective[candidates[pairs], index[pairs]] = self._evaluate(
                widths[index[pairs]], candidates[pairs]
            )
        return objective

    def _batches(self, num_pairs: int) -> Iterator[slice]:
        """Yield slices of the pairs, the systems of each no larger than the cache."""
        size, num_samples = self._z_distances.shape[1:]
        entries = max(len(self._folds) * size, num_samples) * size
        count = min(num_pairs, -(-num_pairs * entries // _STACK_ENTRIES))
        for part in np.array_split(np.arange(num_pairs), count) if count else []:
            yield slice(part[0], part[-1] + 1)

    def _evaluate(self, widths: np.ndarray, candidates: np.ndarray) -> np.ndarray:
        """Return J of pairs of a width and a candidate at each lambda: shape (n, L)."""
        train, h_train, test, h_test = self._systems(widths, candidates)
        num_folds, num_pairs, size = h_train.shape
        systems = ShiftedSystems(
            train.reshape(-1, size, size),
            h_train.reshape(-1, size),
            self._regularizations,
            self._workspace,
        )
        for num_vectors in chain([2, 4], repeat(3)):
            systems.extend(num_vectors)
            if systems.converged(_RTOL[self._dtype]).all():
                break
        alpha = systems.solutions().reshape(num_folds, num_pairs, -1, size)
        image = self._workspace.array('image', alpha.shape, self._dtype)
        np.matmul(alpha, test, out=image)
        quadratic = np.einsum('fnlb,fnlb->fnl', image, alpha)
        linear = np.matmul(alpha, h_test[..., None])[..., 0]
        return np.mean(0.5 * quadratic - linear, axis=0)

    def _systems(self, widths, candidates) -> tuple[np.ndarray, ...]:
        """Return H and h of each fold, for training without it and for testing on it.

        The matrices have shape (F, n, U, U), the vectors (F, n, U).
        """
        size, num_samples = self._z_distances.shape[1:]
        num_folds, num_pairs = len(self._folds), len(widths)

        def scratch(name, *shape):
            return self._workspace.array(name, shape, self._dtype)

        k_z = scratch('k_z', num_pairs, size, num_samples)
        for k, width, candidate in zip(k_z, widths, candidates, strict=True):
            gaussian(self._z_distances[candidate], width, out=k)
        if self._scale is not None:
            k_z *= self._scale[candidates]
        test = scratch('test', num_folds, num_pairs, size, size)
        train = scratch('train', num_folds, num_pairs, size, size)
        joint = scratch('joint', num_pairs, size, num_samples)
        total = scratch('total', num_pairs, size, size)
        self._fold_grams(k_z, out=test)
        np.sum(test, axis=0, out=total)
        np.subtract(total, test, out=train)
        rest = num_samples - self._sizes
        for width, group in groupby(range(num_pairs), key=lambda i: widths[i]):
            first, *_, last = [*group] * 2
            pairs = slice(first, last + 1)
            k_eta = gaussian(self._eta_distances.astype(self._dtype), width)
            k_eta = (
                k_eta[None] if self._columns is None else k_eta[self._columns[candidates[pairs]]]
            )
            np.multiply(k_z[pairs], k_eta, out=joint[pairs])
            gram = scratch('gram', num_folds, len(k_eta), size, size)
            others = scratch('others', num_folds, len(k_eta), size, size)
            self._fold_grams(k_eta, out=gram)
            np.subtract(gram.sum(axis=0), gram, out=others)
            others /= rest**2
            train[:, pairs] *= others
            gram /= self._sizes**2
            test[:, pairs] *= gram
        h = np.matmul(joint, self._indicator).transpose(2, 0, 1)
        return train, (h.sum(axis=0) - h) / rest[..., 0], test, h / self._sizes[..., 0]

    def _fold_grams(self, kernel: np.ndarray, out: np.ndarray) -> None:
        """Write K_f K_f' of (n, U, M), for each fold f of the samples, to (F, n, U, U)."""
        for gram, fold in zip(out, self._folds, strict=True):
            part = kernel[:, :, fold]
            np.matmul(part, part.transpose(0, 2, 1), out=gram)


def gaussian(squared_distance: np.ndarray, width: float, out=None) -> np.ndarray:
    """Return exp(-d^2 / 2 sigma^2) in the type of its argument."""
    out = np.multiply(squared_distance, squared_distance.dtype.type(-0.5 / width**2), out=out)
    return np.exp(out, out=out)


def _merged_centers(returns, states, common, own) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return, for each candidate, one of each set of equal centres and how many it stands for.

    Both have shape (C, U), U the greatest number of different centres; where a candidate has
    fewer, the rest stand for 0. Both are None where that would leave most of the centres.
    """

    def split(labels, channels):
        """Return finer labels of equal centres, told apart by further channels too."""
        for channel in channels:
            _, values = np.unique(states[:, channel], return_inverse=True)
            _, labels = np.unique(labels * len(returns) + values, return_inverse=True)
        return labels

    worthwhile = 0.75 * len(returns)
    shared = split(np.unique(returns, return_inverse=True)[1], common)
    if shared.max() >= worthwhile:
        return None, None
    merged = [
        np.unique(split(shared, channels), return_index=True, return_counts=True)[1:]
        for channels in own
    ]
    size = max(len(index) for index, _ in merged)
    if size > worthwhile:
        return None, None
    pad = [(index, count, (0, size - len(index))) for index, count in merged]
    return (
        np.stack([np.pad(index, width) for index, _, width in pad]),
        np.stack([np.pad(count, width) for _, count, width in pad]),
    )
