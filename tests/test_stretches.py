"""Stretches of true values, against what `itertools.groupby` says."""

from itertools import groupby

import numpy as np
import pytest

from blendcap.numerics.stretches import stretches


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_stretches_are_the_groups_of_true_values(share):
    for seed in range(20):
        flags = np.random.default_rng(seed).random(seed) < share
        expected, place = [], 0
        for true, group in groupby(flags.tolist()):
            length = len(list(group))
            if true:
                expected.append((place, place + length - 1))
            place += length
        assert stretches(flags) == expected
