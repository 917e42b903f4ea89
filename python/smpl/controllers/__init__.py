"""Controllers, estimators and baselines. They give actions in physical units, by the names of any model."""

import warnings
from typing import Any

from smpl.controllers.base import Constant, Controller, Nominal, OpenLoop, Policy, Uniform
from smpl.controllers.baselines import baseline, baselines
from smpl.controllers.bayesian import BayesianOptimization
from smpl.controllers.beer import Profile, isothermal
from smpl.controllers.functions import Function, Noisy
from smpl.controllers.identity import Recorded
from smpl.controllers.kalman import Consistency, ExtendedKalmanFilter, consistency
from smpl.controllers.lqr import LQG, LQR
from smpl.controllers.moving_horizon import MovingHorizonEstimator
from smpl.controllers.nmpc import NMPC
from smpl.controllers.pid import PID, Cascade, Loops
from smpl.controllers.reactor import Proportional
from smpl.controllers.safety import SafetyFilter
from smpl.controllers.sampling import SamplingMPC
from smpl.policies import as_policy

__all__ = [
    "LQG",
    "LQR",
    "NMPC",
    "PID",
    "BayesianOptimization",
    "Cascade",
    "Consistency",
    "Constant",
    "Controller",
    "ExtendedKalmanFilter",
    "Function",
    "Loops",
    "MovingHorizonEstimator",
    "Noisy",
    "Nominal",
    "OpenLoop",
    "Policy",
    "Profile",
    "Proportional",
    "Recorded",
    "SafetyFilter",
    "SamplingMPC",
    "Uniform",
    "baseline",
    "baselines",
    "consistency",
    "isothermal",
]


def __getattr__(name: str) -> Any:
    """Former names."""
    if name == "as_player":
        text = "smpl.controllers.as_player is deprecated, use smpl.policies.as_policy"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        return as_policy
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name)
