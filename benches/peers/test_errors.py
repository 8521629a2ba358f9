"""Tests of the statistics, with noise whose size is known: python -m unittest -v, in this folder."""

import unittest

import numpy as np

from errors import agreement, combined, pooled, ratio_of, relmse, span, time_to

SHAPE = (100, 100, 3)


class Renderer:
    """Pictures of a truth with noise of variance `strength` / spp, relative to the scale of relMSE."""

    def __init__(self, seed, truth, strength):
        self.random, self.truth, self.strength = np.random.default_rng(seed), truth, strength

    def render(self, spp):
        scale = np.sqrt(self.truth**2 + 0.01 * self.truth.mean() ** 2)
        return self.truth + scale * np.sqrt(self.strength / spp) * self.random.standard_normal(self.truth.shape)


def truth():
    return np.random.default_rng(0).uniform(0.05, 1.0, SHAPE)


def mean_relmse(judge, subject, spp):
    """relMSE of ten pictures against what `judge` renders."""
    spps = [16, 16, 64, 64]
    reference = combined([pooled([j.render(n) for n in spps], spps) for j in judge])
    return np.mean([relmse(subject.render(spp), reference, reference.scale()) for _ in range(10)], axis=0)


class Errors(unittest.TestCase):
    def test_the_reference_s_noise_is_taken_off(self):
        """Of 160 samples at a strength of 1 the reference has 0.006; a picture of 100 has 0.01 of its own."""
        plain, _ = mean_relmse([Renderer(1, truth(), 1.0)], Renderer(2, truth(), 1.0), 100)
        self.assertAlmostEqual(plain, 0.01, delta=0.0005)

    def test_a_pool_is_better_than_each_of_its_renderers(self):
        spps = [16, 16, 16, 16]
        pools = [pooled([Renderer(s, truth(), 1.0).render(16) for _ in range(4)], spps) for s in (3, 4)]
        self.assertAlmostEqual(combined(pools).noise(), 0.5 * pools[0].noise(), delta=0.05 * pools[0].noise())

    def test_fireflies_count_in_the_plain_error_only(self):
        reference = pooled([truth()] * 2, [1, 1])
        picture = truth()
        picture[:3, :3] += 100.0
        plain, trimmed = relmse(picture, reference, reference.scale())
        self.assertGreater(plain, 1.0)
        self.assertEqual(trimmed, 0.0)


class Agreements(unittest.TestCase):
    def compare(self, factor, shift=0):
        ours, theirs = Renderer(5, truth(), 1.0), Renderer(6, factor * np.roll(truth(), shift, 0), 4.0)
        spps = [16, 16, 16, 16, 32, 32]
        return agreement([ours.render(n) for n in spps], spps, [theirs.render(n) for n in spps], spps)

    def test_noise_alone_is_no_difference(self):
        found = self.compare(1.0)
        self.assertFalse(found.differs(0.0))
        self.assertLess(abs(found.systematic), 0.01)

    def test_two_percent_are_found_and_measured(self):
        found = self.compare(1.02)
        self.assertAlmostEqual(found.ratio, 1 / 1.02, delta=4 * found.ratio_error)
        self.assertAlmostEqual(found.systematic, 0.02, delta=0.004)
        self.assertGreater(found.upper, 0.02)

    def test_a_picture_one_row_too_low_differs(self):
        self.assertTrue(self.compare(1.0, shift=1).differs(5e-4))


class Times(unittest.TestCase):
    def test_interpolation_follows_a_power_law(self):
        seconds = np.array([1.0, 4.0, 16.0])
        self.assertAlmostEqual(time_to(seconds, 0.3 / seconds, 0.03), 10.0)

    def test_nothing_is_extrapolated(self):
        self.assertIsNone(time_to([1.0, 4.0], [0.3, 0.1], 0.09))
        self.assertIsNone(time_to([1.0, 4.0], [0.3, 0.1], 0.31))
        self.assertEqual(span([([1, 4], [0.3, 0.1]), ([1, 4], [0.5, 0.2])]), (0.2, 0.3))

    def test_an_error_that_rises_again_has_not_been_reached(self):
        self.assertGreater(time_to([1.0, 2.0, 3.0, 4.0], [1.0, 0.4, 0.6, 0.3], 0.5), 3.0)

    def test_intervals_hold_the_true_ratio(self):
        """Of 2,000 intervals of 95 % within four standard deviations of 1,900."""
        random = np.random.default_rng(7)
        held = 0
        for _ in range(2000):
            ours, theirs = np.exp(0.1 * random.standard_normal(5)), 3.0 * np.exp(0.2 * random.standard_normal(5))
            _, low, high = ratio_of(ours, theirs)
            held += low <= 3.0 <= high
        self.assertLess(abs(held - 1900), 4 * (2000 * 0.95 * 0.05) ** 0.5 + 20)


if __name__ == "__main__":
    unittest.main()
