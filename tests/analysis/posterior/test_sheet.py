"""Curved sheets made straight: known bananas, and what is not to be straightened."""

import numpy as np
import pytest
from arviz_stats.base import array_stats
from scipy import stats

from zerobeam.analysis.posterior.convergence import Weights
from zerobeam.analysis.posterior.sampler import IndependenceProposal, sample_density
from zerobeam.analysis.posterior.sheet import Local, sheet_of

THIN = 0.05


def bananas(bend, size=6):
    """Unit normals, of which the last is about bend (x^2 - y^2 / 2) of the first two, THIN times as wide."""

    def residuals(w):
        r = w.copy()
        r[:, -1] = w[:, -1] - bend * (w[:, 0] ** 2 - w[:, 1] ** 2 / 2) / THIN
        jacobian = np.broadcast_to(np.eye(size), (len(w), size, size)).copy()
        jacobian[:, -1, 0] = -2 * bend * w[:, 0] / THIN
        jacobian[:, -1, 1] = bend * w[:, 1] / THIN
        return r, jacobian

    def local(w):
        r, jacobian = residuals(w)
        back = jacobian.transpose(0, 2, 1)
        return Local(-(r**2).sum(axis=1) / 2, -(back @ r[:, :, None])[..., 0], back @ jacobian)

    return local


def turned(local, turn):
    """The same in coordinates that are turned by (f, f)."""

    def own(w):
        at = local(w @ turn)
        return Local(at.value, at.gradient @ turn.T, turn @ at.information @ turn.T)

    return own


@pytest.mark.parametrize("bend", [0.05, 1.0])
def test_bananas_are_straightened_whatever_their_axes(bend):
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(6, 6)))[0]
    local = turned(bananas(bend), turn)
    sheet = sheet_of(local, 6)
    assert sheet.curved == 2
    u = np.random.default_rng(2).normal(size=(500, 6))
    # A unit normal, to the digits of the polynomial.
    value = local(sheet.forth(u)).value
    np.testing.assert_allclose(value - value[0], -(u**2).sum(axis=1) / 2 + (u[0] ** 2).sum() / 2, atol=1e-3)


def test_it_keeps_volume():
    sheet = sheet_of(bananas(0.3), 6)
    step = 1e-6
    volumes = []
    for point in 2 * np.random.default_rng(2).normal(size=(20, 6)):
        sides = [
            sheet.forth(point + step * e[None])[0] - sheet.forth(point - step * e[None])[0] for e in np.eye(6)
        ]
        volumes.append(abs(np.linalg.det(np.array(sides) / (2 * step))))
    np.testing.assert_allclose(volumes, volumes[0], rtol=1e-4)


def test_nothing_curved_is_left_as_it_is():
    assert sheet_of(bananas(0.0), 6) is None
    assert sheet_of(bananas(0.002), 6) is None


def test_a_ridge_that_is_not_found_is_no_sheet():
    """Beyond a quarter of a std the density is 0."""
    local = bananas(1.0)

    def with_edge(w):
        at = local(w)
        return at._replace(value=np.where(np.abs(w[:, 0]) < 0.6, at.value, -np.inf))

    assert sheet_of(with_edge, 6) is None


@pytest.mark.parametrize("bend", [0.05, 1.0])
def test_a_sheet_is_sampled_right_in_its_own_coordinates_and_wrong_without(bend):
    """x ~ N(0, 1) and a thin sheet about it. Weights of what is proposed tell the two apart."""
    local = bananas(bend)
    sheet = sheet_of(local, 6)
    proposal = IndependenceProposal(np.zeros(6), np.eye(6), 12.0)
    weights = []

    def agrees(judged, proposed):
        weights.append(Weights.of(proposed.log_weights))
        return True

    sampled = sample_density(
        lambda u: local(sheet.forth(u)).value,
        proposal,
        seed=2,
        ess=3000,
        judged=lambda u: sheet.forth(u.reshape(-1, 6)).reshape(u.shape),
        agrees=agrees,
    )
    assert sampled.done
    chains = sampled.judged.reshape(-1, *sampled.judged.shape[2:])
    for j, p in ((0, 0.025), (0, 0.5), (1, 0.975), (2, 0.025)):
        below = (chains[..., j] <= stats.norm.ppf(p)).astype(float)
        error = np.sqrt(p * (1 - p) / float(array_stats.ess(below, method="mean")))
        assert abs(below.mean() - p) < 4.5 * error
    last = chains[..., -1]
    error = float(array_stats.mcse(last, method="mean"))
    assert last.mean() == pytest.approx(bend / THIN / 2, abs=4.5 * error)
    plain = proposal.draw(20_000, np.random.default_rng(1))
    without = Weights.of(local(plain).value - proposal.log_density(plain))
    assert weights[-1].serve
    assert weights[-1].share > 0.8
    assert without.share < weights[-1].share / 2
    assert not (without.serve and bend == 1.0)
