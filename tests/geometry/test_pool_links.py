"""Which pools may become one object."""

import numpy as np
import pytest

from edgemap.geometry.objects.association import AssociationRule
from edgemap.geometry.objects.pool_index import _joins, distances


@pytest.fixture
def places():
    random = np.random.default_rng(0)
    own = random.uniform(0.005, 0.05, (2, 40))
    landmarks = random.choice([-1.0, 1.0, 2.0], 40)
    return np.array([*random.uniform(0, 1.5, (2, 40)), own[0], np.zeros(40), own[1], np.zeros(40), landmarks])


def test_one_pair_is_judged_as_in_a_table_of_all(places):
    rule = AssociationRule()
    table = np.isfinite(distances(places, places, rule))
    pairs = [[_joins(places[:, a].tolist(), places[:, b].tolist(), rule) for b in range(40)] for a in range(40)]
    assert 0.1 < table.mean() < 0.9
    assert (table == pairs).all()
