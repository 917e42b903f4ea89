"""Layers of other packages' networks, by the names of their classes without imports."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from smpl.deploy.laws import Layer

_ACTIVATIONS = {
    "Tanh": "tanh", "ReLU": "relu", "ELU": "elu", "LeakyReLU": "leaky_relu", "Sigmoid": "sigmoid",
}  # fmt: skip
# Modules that change nothing when a policy acts.
_NEUTRAL = ("Flatten", "FlattenExtractor", "Dropout", "Identity")


def network_of(policy: Any) -> tuple[Layer, ...] | None:
    """The layers of a Stable-Baselines3 policy or TorchScript module, deterministic; else None.

    Raises:
        ValueError: the network has modules that cannot be exported; the message names the first.
    """
    inner: Any = getattr(policy, "policy", None)
    if hasattr(inner, "action_net"):  # PPO, A2C, TRPO
        body = _stable_baselines(inner, inner.mlp_extractor.policy_net, inner.action_net)
        return _with_tanh(body) if getattr(inner, "squash_output", False) else body
    actor: Any = getattr(inner, "actor", None)
    if hasattr(actor, "latent_pi"):  # SAC, TQC
        return _with_tanh(_stable_baselines(actor, actor.latent_pi, actor.mu))
    if hasattr(actor, "mu"):  # TD3, DDPG
        return _stable_baselines(actor, actor.mu)
    module = getattr(policy, "_module", policy)
    if hasattr(module, "named_modules") and callable(module):
        return _layers([module])
    return None


def _stable_baselines(owner: Any, *parts: Any) -> tuple[Layer, ...]:
    extractor = getattr(owner, "pi_features_extractor", None) or getattr(owner, "features_extractor", None)
    return _layers([] if extractor is None else [extractor], parts)


def _layers(before: list[Any], parts: Any = ()) -> tuple[Layer, ...]:
    found: list[Layer] = []
    for module in (leaf for one in (*before, *parts) for leaf in _leaves(one)):
        name = _name(module)
        if name == "Linear":
            bias = getattr(module, "bias", None)
            weight = _numbers(module.weight)
            found.append(Layer(weight, np.zeros(len(weight), np.float32) if bias is None else _numbers(bias)))
        elif name in _ACTIVATIONS and found:
            slope = getattr(module, "negative_slope", getattr(module, "alpha", 1.0))
            # Two activations one after the other need a layer between them.
            if found[-1].activation != "linear":
                found.append(_identity(len(found[-1].bias)))
            found[-1] = Layer(found[-1].weight, found[-1].bias, _ACTIVATIONS[name], float(slope))
        elif name not in _NEUTRAL:
            raise ValueError(
                f"the network has a module {name}, which cannot be exported; there are: Linear, "
                f"{', '.join(_ACTIVATIONS)}"
            )
    if not found:
        raise ValueError("the network has no linear layer")
    return tuple(found)


def _leaves(module: Any) -> Iterator[Any]:
    """Modules without parts, in their order; only sequences may have parts."""
    children = list(module.children()) if callable(getattr(module, "children", None)) else []
    if not children:
        yield module
    elif _name(module) in ("Sequential", *_NEUTRAL):
        for one in children:
            yield from _leaves(one)
    else:
        raise ValueError(
            f"the network has a module {_name(module)} with parts in an unknown order; make it a Sequential of linear "
            "layers and activations"
        )


def _name(module: Any) -> str:
    return str(getattr(module, "original_name", type(module).__name__))


def _with_tanh(layers: tuple[Layer, ...]) -> tuple[Layer, ...]:
    last = layers[-1]
    if last.activation != "linear":
        return (*layers, replace(_identity(len(last.bias)), activation="tanh"))
    return (*layers[:-1], Layer(last.weight, last.bias, "tanh"))


def _identity(size: int) -> Layer:
    return Layer(np.eye(size, dtype=np.float32), np.zeros(size, np.float32))


def _numbers(tensor: Any) -> Any:
    return np.asarray(tensor.detach().cpu().numpy(), dtype=np.float32)
