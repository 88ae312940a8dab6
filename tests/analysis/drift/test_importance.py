"""Densities of nodes that are kept while passes are added, against those of all passes at once."""

from __future__ import annotations

import numpy as np
from scipy import stats

from zerobeam.analysis.drift.importance import Nodes, Pass, about, from_pass


def test_nodes_that_passes_were_added_to_have_the_densities_of_the_whole_mixture() -> None:
    prior: Pass = (np.array([-4.0, -5.0]), 1.5 * np.eye(2))
    nodes = Nodes.of(from_pass(prior, 16, 0), [prior])
    for number in (1, 2):
        near = about(nodes.points, np.exp(nodes.points[:, 0]) / np.exp(nodes.points[:, 0]).sum())
        nodes = nodes.followed_by(near, from_pass(near, 16, number))
    assert (len(nodes.passes), len(nodes.points)) == (3, 48)
    densities = [stats.multivariate_normal(c, r @ r.T).pdf(nodes.points) for c, r in nodes.passes]
    np.testing.assert_allclose(np.exp(nodes.over), densities[0] / np.mean(densities, axis=0), rtol=1e-12)
    against = np.exp(nodes.against) * np.mean(densities, axis=0)
    np.testing.assert_allclose(against, against[0], rtol=1e-12)
