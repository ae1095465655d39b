"""Classes learnt from samples whose class is known: maximum likelihood, support vectors, random forest; and mixtures.

Maximum likelihood is the thesis's normal classes taken at their word; the others are scikit-learn's, on standardized
features. Samples that hold a NaN belong to no class.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.fusion.kmeans import UNCLASSIFIED
from processing.fusion.separability import Statistics

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]
Method = Literal["likelihood", "svm", "forest"]


class Classifier(Protocol):
    """Something that tells the class of samples."""

    def __call__(self, samples: ArrayLike) -> Labels:
        """Class numbers (n,) of samples (n, d); ``UNCLASSIFIED`` for those with a NaN."""


@dataclass(frozen=True)
class MaximumLikelihood:
    """The normal class under which a sample is likeliest.

    Args:
        classes: the classes, of two samples at least each.
        priors: how likely each is before a sample is seen; all alike if left out.
    """

    classes: tuple[Statistics, ...]
    priors: tuple[float, ...] | None = None

    def scores(self, samples: ArrayLike) -> Floats:
        """(n, classes) logarithm of prior times density.

        Raises:
            DataError: a covariance that is not positive definite, or priors that are none.
        """
        x = np.asarray(samples, dtype=np.float64)
        priors = np.full(len(self.classes), 1 / len(self.classes)) if self.priors is None else np.array(self.priors)
        if priors.shape != (len(self.classes),) or not ((priors > 0) & np.isfinite(priors)).all():
            raise DataError(f"priors {priors} for {len(self.classes)} classes", "give one positive number a class")
        made = np.empty((len(x), len(self.classes)))
        for k, known in enumerate(self.classes):
            try:
                factor = np.linalg.cholesky(known.covariance)
            except np.linalg.LinAlgError:
                raise DataError(
                    f"the covariance of '{known.name}' is not positive definite", "use a larger region"
                ) from None
            white = np.linalg.solve(factor, (x - known.mean).T)
            spread = float(np.sum(np.log(np.diag(factor))))
            made[:, k] = np.log(priors[k] / priors.sum()) - spread - 0.5 * np.sum(white**2, axis=0)
        made -= 0.5 * x.shape[1] * np.log(2 * np.pi)
        return made

    def __call__(self, samples: ArrayLike) -> Labels:
        """Class numbers (n,) of samples (n, d); ``UNCLASSIFIED`` for those with a NaN."""
        scores = self.scores(samples)
        defined = np.isfinite(scores).all(axis=1)
        labels = np.full(len(scores), UNCLASSIFIED, dtype=np.int64)
        labels[defined] = np.argmax(scores[defined], axis=1)
        return labels


@dataclass(frozen=True)
class _Learnt:
    model: Any
    dimensions: int

    def __call__(self, samples: ArrayLike) -> Labels:
        x = np.asarray(samples, dtype=np.float64)
        if x.ndim != 2 or x.shape[1] != self.dimensions:
            raise DataError(f"samples of shape {x.shape}", f"give {self.dimensions} features a sample")
        labels = np.full(len(x), UNCLASSIFIED, dtype=np.int64)
        defined = np.isfinite(x).all(axis=1)
        if defined.any():
            labels[defined] = self.model.predict(x[defined])
        return labels


def learn(samples: Sequence[ArrayLike], method: Method, *, seed: int = 0) -> Classifier:
    """A classifier from samples of every class.

    Args:
        samples: (n_k, d) of class k; those with a NaN are left out.
        method: ``"likelihood"`` (normal classes), ``"svm"`` (radial basis functions) or ``"forest"``.
        seed: of the forest.

    Raises:
        DataError: fewer than two classes, a class with too few samples, or an unknown method.
    """
    from processing.fusion.separability import class_statistics

    if len(samples) < 2:
        raise DataError(f"{len(samples)} classes to learn", "give samples of two classes at least")
    known = [_defined(item, k) for k, item in enumerate(samples)]
    if len({item.shape[1] for item in known}) != 1:
        raise DataError("classes of different numbers of features", "use the same features")
    if method == "likelihood":
        return MaximumLikelihood(
            tuple(class_statistics(x, f"class {k + 1}", singular="regularize") for k, x in enumerate(known))
        )
    from sklearn.ensemble import RandomForestClassifier
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler
    from sklearn.svm import SVC

    if method == "svm":
        model: Any = make_pipeline(StandardScaler(), SVC(C=10.0, class_weight="balanced"))
    elif method == "forest":
        model = RandomForestClassifier(200, min_samples_leaf=2, class_weight="balanced", random_state=seed)
    else:
        raise DataError(f"there is no classifier {method!r}", "use likelihood, svm or forest")
    model.fit(np.concatenate(known), np.repeat(np.arange(len(known)), [len(item) for item in known]))
    return _Learnt(model, known[0].shape[1])


@dataclass(frozen=True)
class Mixture:
    """Normal classes found without knowing any."""

    labels: Labels
    """(n,) likeliest class; ``UNCLASSIFIED`` for samples with a NaN."""
    classes: tuple[Statistics, ...]
    weights: Floats
    """(classes,) share of each."""
    information: float
    """Bayesian information criterion; smaller is better."""


def gaussian_mixture(samples: ArrayLike, classes: int | None = None, *, most: int = 8, seed: int = 0) -> Mixture:
    """Fit a mixture of normal classes by expectation and maximization (scikit-learn's).

    Args:
        samples: (n, d).
        classes: how many; where left out, the number up to ``most`` with the least Bayesian information criterion.
        most: largest number that is tried.
        seed: of the start.

    Raises:
        DataError: too few defined samples.
    """
    from sklearn.mixture import GaussianMixture

    every = np.asarray(samples, dtype=np.float64)
    if every.ndim != 2 or not every.shape[1]:
        raise DataError(f"samples of a mixture have shape {every.shape}", "give (n, d)")
    defined = np.isfinite(every).all(axis=1)
    x = every[defined]
    scale = float(np.var(x, axis=0).max()) if len(x) else 0.0
    distinct = len(np.unique(x, axis=0)) if scale > 0 else min(len(x), 1)
    if distinct < (1 if classes is None else classes):
        raise DataError(f"{distinct} different samples for a mixture", "use a larger image, or ask for fewer classes")
    if len(x) < 2 * (1 if classes is None else classes) * every.shape[1]:
        raise DataError(f"{len(x)} defined samples for a mixture", "use a larger image, or ask for fewer classes")
    counts = range(1, most + 1) if classes is None else (classes,)
    fits = [
        GaussianMixture(k, reg_covar=1e-9 * scale if scale > 0 else 1e-12, n_init=3, random_state=seed).fit(x)
        for k in counts
        if len(x) >= 2 * k * every.shape[1] and distinct >= k
    ]
    best = min(fits, key=lambda model: model.bic(x))
    labels = np.full(len(every), UNCLASSIFIED, dtype=np.int64)
    labels[defined] = best.predict(x)
    found = tuple(
        Statistics(f"class {k + 1}", best.means_[k], best.covariances_[k], int(np.sum(labels == k)))
        for k in range(best.n_components)
    )
    return Mixture(labels, found, best.weights_, float(best.bic(x)))


def _defined(samples: ArrayLike, number: int) -> Floats:
    x = np.asarray(samples, dtype=np.float64)
    if x.ndim != 2:
        raise DataError(f"samples of class {number + 1} have shape {x.shape}", "give (n, d)")
    x = x[np.isfinite(x).all(axis=1)]
    if len(x) < 2:
        raise DataError(f"class {number + 1} has {len(x)} defined samples", "draw a larger region")
    return x
