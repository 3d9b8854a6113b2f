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
  and so is J.

The screening is approximate by a known amount: float32, Krylov spaces that end early, and widths
given up after a few vectors when J is far above the best. Its errors are far below the
tolerances given here, and whatever comes within `TOLERANCE` is evaluated again in float64.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np
from scipy.spatial.distance import cdist

from .samples import StepSamples
from .shifted_systems import ShiftedSystems
from .workspace import Workspace

#: Points of the grid whose J in float32 lies this close to the best are evaluated in float64.
#: The greatest error of J seen there, on a grid point of 6 heavy-tailed samples, is a fifth
#: of it; with 30 samples or more it is a twentieth.
TOLERANCE = 5e-4
#: Residual of the systems, relative to h.
_RTOL = {np.float32: 1e-5, np.float64: 1e-12}
#: Vectors after which a width is given up if its least J is so much above the best known one.
#: No J was seen to fall by half as much afterwards.
_ROUGH_VECTORS = (2, 6)
_ROUGH_MARGIN = 0.25
#: Regularisations below this drown in the rounding of float32.
_LEAST_COARSE_REGULARIZATION = 1e-4
#: Gaussians below exp(-this) count as 0; against any regularisation above 1e-4 they do.
_ISOLATED = 45.0
#: Greatest number of entries in one stack of matrices: larger ones fall out of the cache.
_STACK_ENTRIES = 1_000_000


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
    workspace : Workspace

    """

    def __init__(
        self,
        step: StepSamples,
        subsets: Sequence[Sequence[int]],
        regularizations: np.ndarray,
        dtype: type,
        workspace: Workspace,
    ):
        order = np.argsort(step.folds, kind='stable')
        folds = step.folds[order]
        returns, states = step.returns[order], step.states[order]
        self._regularizations = regularizations
        self._dtype = dtype
        self._workspace = workspace
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
        self._z_distances = workspace.array('z_distances', shape, dtype)
        self._isolation = np.empty(len(subsets))
        is_other_fold = folds[centers][:, None] != folds
        for i, channels in enumerate(own):
            chosen = states[:, channels]
            distances = shared + cdist(chosen[centers], chosen, 'sqeuclidean')
            self._isolation[i] = distances[is_other_fold].min()
            self._z_distances[i] = distances if columns is None else distances[columns[i]]

    def evaluate(self, widths: Sequence[float], candidates: Sequence[int]) -> np.ndarray:
        """Return J of each pair of a width and a candidate at each lambda: shape (pairs, L)."""
        result = np.empty((len(widths), len(self._regularizations)))
        for pairs, batch in self._batches(np.asarray(widths), np.asarray(candidates)):
            batch.solve()
            result[pairs] = batch.objective()
        return result

    def screen(self, widths: np.ndarray) -> np.ndarray:
        """Return J of all candidates at all widths: shape (C, len(widths), L).

        Points that are not within `TOLERANCE` of the best of their candidate may have been left
        at a rough value above that.
        """
        num_candidates, num_lambdas = len(self._z_distances), len(self._regularizations)
        objective = np.zeros((num_candidates, len(widths), num_lambdas))
        least = np.full(num_candidates, np.inf)
        # From the great widths down: there the systems are easy and soon set a mark.
        which, candidates = (
            index.ravel()
            for index in np.meshgrid(
                np.argsort(widths)[::-1], np.arange(num_candidates), indexing='ij'
            )
        )
        reached = 2 * _ISOLATED * widths[which] ** 2 > self._isolation[candidates]
        which, candidates = which[reached], candidates[reached]
        for pairs, batch in self._batches(widths[which], candidates):
            own = candidates[pairs]
            for vectors in _ROUGH_VECTORS:
                batch.extend(vectors)
                if batch.converged().all():
                    break
            values = batch.objective()
            np.minimum.at(least, own, values.min(axis=1))
            hopeful = ~batch.converged() & (values.min(axis=1) < least[own] + _ROUGH_MARGIN)
            if hopeful.any():
                if not hopeful.all():
                    batch.keep(np.flatnonzero(hopeful))
                batch.solve()
                values[hopeful] = batch.objective()
                np.minimum.at(least, own, values.min(axis=1))
            objective[own, which[pairs]] = values
        return objective

    def _batches(self, widths, candidates) -> Iterator[tuple[slice, _Batch]]:
        """Yield slices of the pairs and their systems, none larger than the cache."""
        size, num_samples = self._z_distances.shape[1:]
        entries = max(len(self._folds) * size, num_samples) * size
        count = -(-len(widths) * entries // _STACK_ENTRIES)
        for part in np.array_split(np.arange(len(widths)), min(count, len(widths))):
            pairs = slice(part[0], part[-1] + 1)
            yield pairs, self._batch(widths[pairs], candidates[pairs])

    def _batch(self, widths, candidates) -> _Batch:
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
        return _Batch(
            train=train,
            h_train=(h.sum(axis=0) - h) / rest[..., 0],
            test=test,
            h_test=h / self._sizes[..., 0],
            lambdas=self._regularizations,
            workspace=self._workspace,
        )

    def _fold_grams(self, kernel: np.ndarray, out: np.ndarray) -> None:
        """Write K_f K_f' of (n, U, M), for each fold f of the samples, to (F, n, U, U)."""
        for gram, fold in zip(out, self._folds, strict=True):
            part = kernel[:, :, fold]
            np.matmul(part, part.transpose(0, 2, 1), out=gram)


class _Batch:
    """The systems of some pairs of a width and a candidate, all folds together."""

    def __init__(self, *, train, h_train, test, h_test, lambdas, workspace):
        self._num_folds, self._num_pairs, size, _ = train.shape
        self._test, self._h_test = test, h_test
        self._workspace = workspace
        self._rtol = _RTOL[train.dtype.type]
        self._systems = ShiftedSystems(
            train.reshape(-1, size, size), h_train.reshape(-1, size), lambdas, workspace
        )

    def extend(self, num_vectors: int) -> None:
        self._systems.extend(num_vectors)

    def converged(self) -> np.ndarray:
        by_fold = self._systems.converged(self._rtol).reshape(self._num_folds, self._num_pairs)
        return by_fold.all(axis=0)

    def solve(self) -> None:
        while True:
            self._systems.extend(4)
            if self.converged().all():
                return

    def keep(self, pairs: np.ndarray) -> None:
        folds = np.arange(self._num_folds)[:, None]
        self._systems.keep((folds * self._num_pairs + pairs).ravel())
        self._test, self._h_test = self._test[:, pairs], self._h_test[:, pairs]
        self._num_pairs = len(pairs)

    def objective(self) -> np.ndarray:
        alpha = self._systems.solutions()
        alpha = alpha.reshape(self._num_folds, self._num_pairs, *alpha.shape[1:])
        image = self._workspace.array('image', alpha.shape, alpha.dtype)
        np.matmul(alpha, self._test, out=image)
        quadratic = np.einsum('fnlb,fnlb->fnl', image, alpha)
        linear = np.matmul(alpha, self._h_test[..., None])[..., 0]
        return np.mean(0.5 * quadratic - linear, axis=0)


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
