"""Errors of pictures against references that have noise of their own, and times to equal error."""

import math
from dataclasses import dataclass

import numpy as np

# Share of the worst pixels that the trimmed error leaves out.
TRIM = 0.001
# Of the squared mean radiance, below which errors no longer count as relative.
FLOOR = 0.01
# Two-sided 95 % of Student's t with 1, 2, … degrees of freedom.
STUDENT = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228]


@dataclass
class Reference:
    """The best known picture, and the variance of its pixels."""

    picture: np.ndarray
    variance: np.ndarray

    def scale(self):
        """What squared errors are divided by."""
        return self.picture**2 + FLOOR * self.picture.mean() ** 2

    def noise(self, scale=None):
        """Its own relMSE, trimmed."""
        return trimmed_mean((self.variance / (self.scale() if scale is None else scale)).mean(2))


def trimmed_mean(values):
    values = np.sort(values, axis=None)
    return float(values[: len(values) - round(TRIM * len(values))].mean())


def pooled(pictures, spps):
    """The mean of independent pictures of one renderer, whose variance goes with 1 / spp."""
    weights = np.array(spps, float)
    stack = np.array(pictures, np.float64)
    mean = np.tensordot(weights / weights.sum(), stack, 1)
    squares = np.tensordot(weights, (stack - mean) ** 2, 1)
    return Reference(mean, squares / (len(weights) - 1) / weights.sum())


def combined(references):
    """The mean of several renderers' pictures, each with its weight by its noise."""
    weights = np.array([1.0 / max(reference.noise(), 1e-12) for reference in references])
    weights /= weights.sum()
    picture = sum(w * r.picture for w, r in zip(weights, references))
    return Reference(picture, sum(w * w * r.variance for w, r in zip(weights, references)))


def relmse(picture, reference, scale):
    """relMSE, plain and without the worst pixels, with what is due to the reference's noise taken off.

    `scale` is the same for all that are compared, also where their references differ: noise in a dark reference would
    change what errors count as.
    """
    raw = ((picture - reference.picture) ** 2 / scale).mean(2).ravel()
    due = (reference.variance / scale).mean(2).ravel()
    order = np.argsort(raw)
    kept = order[: len(order) - round(TRIM * len(order))]
    return float((raw - due).mean()), float((raw[kept] - due[kept]).mean())


@dataclass
class Agreement:
    """How far two renderers' pictures are apart beyond their joint noise, as a share of what they show.

    Squared differences are products of what two disjoint sets of pictures say, so that noise adds nothing on average.
    A negative one happens by chance where there is no difference; its root is given a minus.
    """

    # Of the pictures' means.
    ratio: float
    ratio_error: float
    # Root mean squares over blocks: joint noise, what is beyond it, and its one-sided bound of 95 %.
    noise: float
    systematic: float
    upper: float
    # Over cells of a few pixels, squared: about what it would add to a relMSE.
    cells: float
    cells_error: float

    def differs(self, harmless):
        """Whether the pictures are apart for certain, and by more than `harmless`."""
        return self.cells > harmless and self.cells > 4.0 * self.cells_error


def block_means(pictures, blocks):
    stack = np.asarray(pictures, np.float64)
    count, height, width, channels = stack.shape
    return stack.reshape(count, blocks, height // blocks, blocks, width // blocks, channels).mean((2, 4))


def signed_root(x):
    return math.copysign(math.sqrt(abs(x)), x)


def squared_difference(ours, theirs):
    """Mean of the squared relative differences of (blocks, weights), without noise, and its standard error."""
    halves = []
    for part in (0, 1):
        (a, wa), (b, wb) = [(x[part::2], np.asarray(w, float)[part::2]) for x, w in (ours, theirs)]
        halves.append(np.tensordot(wa / wa.sum(), a, 1) - np.tensordot(wb / wb.sum(), b, 1))
    middle = 0.5 * (pooled(*ours).picture + pooled(*theirs).picture)
    values = (halves[0] * halves[1] / Reference(middle, None).scale()).mean(2)
    return float(values.mean()), float(values.std(ddof=1) / math.sqrt(values.size))


def agreement(ours, our_spps, theirs, their_spps, blocks=20, cell=4):
    coarse = (block_means(ours, blocks), our_spps), (block_means(theirs, blocks), their_spps)
    a, b = (pooled(*side) for side in coarse)
    scale = Reference(0.5 * (a.picture + b.picture), None).scale()
    squared, error = squared_difference(*coarse)
    means = [pooled(np.mean(p, (1, 2, 3), keepdims=True), s) for p, s in ((ours, our_spps), (theirs, their_spps))]
    ratio = float(means[0].picture.item() / means[1].picture.item())
    ratio_error = math.sqrt(sum(m.variance.item() / m.picture.item() ** 2 for m in means))
    cells = np.asarray(ours[0]).shape[0] // cell
    fine = squared_difference((block_means(ours, cells), our_spps), (block_means(theirs, cells), their_spps))
    return Agreement(
        ratio,
        ratio * ratio_error,
        math.sqrt(((a.variance + b.variance) / scale).mean()),
        signed_root(squared),
        math.sqrt(max(squared + 1.645 * error, 0.0)),
        *fine,
    )


# Times to equal error.


def time_to(seconds, errors, target):
    """Seconds at which the error falls to the target for good; None where it was not so measured.

    Between two measurements the curve is straight in logarithms.
    """
    points = sorted(zip(seconds, errors))
    for (t0, e0), (t1, e1) in reversed(list(zip(points, points[1:]))):
        if e0 > target >= e1 and e1 > 0.0:
            share = math.log(e0 / target) / math.log(e0 / e1)
            return t0 * (t1 / t0) ** share
    return None


def span(curves):
    """The least and greatest error that all curves of (seconds, errors) pass through."""
    return max(min(errors) for _, errors in curves), min(max(errors) for _, errors in curves)


def log_mean(values):
    """Geometric mean, and the squared standard error and degrees of freedom of its logarithm."""
    logs = np.log(values)
    variance = logs.var(ddof=1) / len(logs) if len(logs) > 1 else math.inf
    return math.exp(logs.mean()), float(variance), len(logs) - 1


def ratio_of(ours, theirs):
    """Their times over ours, with an interval of 95 %: both are one time per seed."""
    (a, va, fa), (b, vb, fb) = log_mean(ours), log_mean(theirs)
    if not math.isfinite(va + vb):
        return b / a, 0.0, math.inf
    # Welch and Satterthwaite.
    freedom = (va + vb) ** 2 / max(va**2 / fa + vb**2 / fb, 1e-300)
    width = STUDENT[min(max(int(freedom), 1), len(STUDENT)) - 1] * math.sqrt(va + vb)
    return b / a, b / a * math.exp(-width), b / a * math.exp(width)
