"""A policy trained by the exact gradient through episodes of the reactor.

    python python/examples/policy_gradient.py --iterations 60

The cost of an episode, here the squared distance from the steady state at the end of each step, is
a function of the policy's weights. Its gradient follows from the derivatives of each control step
(`Model.sensitivity`) by the chain rule, backwards in time: no sampling of actions, no critic.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import smpl
from smpl.model import Model
from smpl.support.arguments import FloatArray


@dataclass
class Policy:
    """A layer of tanh between scaled states and scaled actions within their box."""

    goal: FloatArray
    width: FloatArray
    low: FloatArray
    high: FloatArray
    weights: list[FloatArray]

    @classmethod
    def small(cls, env: smpl.Env, starts: FloatArray, hidden: int = 8, seed: int = 0) -> Policy:
        """A policy that begins near the middle of the actions."""
        rng = np.random.default_rng(seed)
        states, actions = starts.shape[1], len(env.action_low)
        weights = [
            rng.normal(0, 1 / np.sqrt(states), (hidden, states)),
            np.zeros(hidden),
            rng.normal(0, 0.1 / np.sqrt(hidden), (actions, hidden)),
            np.zeros(actions),
        ]
        width = np.maximum(np.ptp(starts, axis=0), 1e-3 * np.abs(starts).max(axis=0))
        return cls(np.array(env.steady_state)[:states], width, env.action_low, env.action_high, weights)

    def act(self, x: FloatArray) -> tuple[FloatArray, tuple[FloatArray, ...]]:
        """Actions for the states of several episodes, (N, actions), and what the way back needs."""
        w_1, b_1, w_2, b_2 = self.weights
        scaled = (x - self.goal) / self.width
        hidden = np.tanh(scaled @ w_1.T + b_1)
        out = np.tanh(hidden @ w_2.T + b_2)
        return (self.low + self.high) / 2 + (self.high - self.low) / 2 * out, (scaled, hidden, out)

    def back(self, kept: tuple[FloatArray, ...], by_action: FloatArray) -> tuple[FloatArray, list[FloatArray]]:
        """From derivatives by actions those by states and by weights."""
        scaled, hidden, out = kept
        inner = by_action * (self.high - self.low) / 2 * (1 - out**2)
        outer = (inner @ self.weights[2]) * (1 - hidden**2)
        by_weights = [outer.T @ scaled, outer.sum(axis=0), inner.T @ hidden, inner.sum(axis=0)]
        return outer @ self.weights[0] / self.width, by_weights


def gradient(
    model: Model, policy: Policy, starts: FloatArray, steps: int, threads: int | None = None
) -> tuple[float, list[FloatArray]]:
    """Mean cost of episodes from these starts, and its gradient by the policy's weights."""
    x, cost, tape = starts, 0.0, []
    for step in range(steps):
        action, kept = policy.act(x)
        x, by_x, by_u, _ = model.sensitivity(x, action, first_step=step, threads=threads)
        distance = (x - policy.goal) / policy.width
        cost += float((distance**2).sum(axis=1).mean())
        tape.append((kept, by_x, by_u, 2 * distance / policy.width / len(starts)))
    by_state = np.zeros_like(starts)
    by_weights = [np.zeros_like(w) for w in policy.weights]
    for kept, by_x, by_u, own in reversed(tape):
        by_state = by_state + own
        through, parts = policy.back(kept, np.einsum("nij,ni->nj", by_u, by_state))
        by_state = np.einsum("nij,ni->nj", by_x, by_state) + through
        by_weights = [total + part for total, part in zip(by_weights, parts, strict=True)]
    return cost, by_weights


def train(
    model: Model, policy: Policy, starts: FloatArray, steps: int, iterations: int, rate: float = 0.02
) -> list[float]:
    """Descends the gradient by Adam (Kingma and Ba 2015); the mean cost of each iteration."""
    first = [np.zeros_like(w) for w in policy.weights]
    second = [np.zeros_like(w) for w in policy.weights]
    costs = []
    for k in range(1, iterations + 1):
        value, slopes = gradient(model, policy, starts, steps)
        costs.append(value)
        for w, m, v, slope in zip(policy.weights, first, second, slopes, strict=True):
            m += 0.1 * (slope - m)
            v += 0.001 * (slope**2 - v)
            w -= rate * (m / (1 - 0.9**k)) / (np.sqrt(v / (1 - 0.999**k)) + 1e-12)
    return costs


def starts_of(env: smpl.Env, count: int) -> FloatArray:
    """States at which episodes begin."""
    states = []
    for seed in range(count):
        env.reset(seed=seed)
        states.append(np.array(env.state))
    return np.array(states)


def main(arguments: Sequence[str] | None = None) -> list[float]:
    """Trains and prints the mean cost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", default="reactor")
    parser.add_argument("--episodes", type=int, default=16)
    parser.add_argument("--steps", type=int, default=15)
    parser.add_argument("--iterations", type=int, default=60)
    chosen = parser.parse_args(arguments)
    env = smpl.Env(chosen.model, normalize=False)
    starts = starts_of(env, chosen.episodes)
    policy = Policy.small(env, starts)
    costs = train(env.model, policy, starts, chosen.steps, chosen.iterations)
    for k in sorted({*range(0, len(costs), max(1, len(costs) // 10)), len(costs) - 1}):
        print(f"iteration {k:4d}: mean cost {costs[k]:.6g}")
    return costs


if __name__ == "__main__":
    main()
