"""Controllers, estimators and baselines for any model; actions are in physical units."""

import warnings
from typing import Any

from smpl.controllers.base import Constant, Controller, Nominal, OpenLoop, Policy, Uniform
from smpl.controllers.baselines import baseline, baselines
from smpl.controllers.bayesian import BayesianOptimization, BayesianOptions
from smpl.controllers.beer import Profile, isothermal
from smpl.controllers.functions import Function, Noisy
from smpl.controllers.identity import Recorded
from smpl.controllers.kalman import Consistency, EstimatorOptions, ExtendedKalmanFilter, consistency
from smpl.controllers.lqr import LQG, LQR
from smpl.controllers.moving_horizon import MovingHorizonEstimator, MovingHorizonOptions
from smpl.controllers.nmpc import NMPC
from smpl.controllers.nmpc_options import NMPCConstraints, NMPCObjective, NMPCOptions, NMPCPrediction, NMPCSolver
from smpl.controllers.nmpc_sensitivity import ActionDerivatives
from smpl.controllers.pid import PID, Cascade, Loops, PIDOptions
from smpl.controllers.reactor import Proportional
from smpl.controllers.safety import SafetyFilter
from smpl.controllers.sampling import SamplingMPC, SamplingOptions
from smpl.policies import as_policy
from smpl.support.hints import of_attribute

__all__ = [
    "LQG",
    "LQR",
    "NMPC",
    "PID",
    "ActionDerivatives",
    "BayesianOptimization",
    "BayesianOptions",
    "Cascade",
    "Consistency",
    "Constant",
    "Controller",
    "EstimatorOptions",
    "ExtendedKalmanFilter",
    "Function",
    "Loops",
    "MovingHorizonEstimator",
    "MovingHorizonOptions",
    "NMPCConstraints",
    "NMPCObjective",
    "NMPCOptions",
    "NMPCPrediction",
    "NMPCSolver",
    "Noisy",
    "Nominal",
    "OpenLoop",
    "PIDOptions",
    "Policy",
    "Profile",
    "Proportional",
    "Recorded",
    "SafetyFilter",
    "SamplingMPC",
    "SamplingOptions",
    "Uniform",
    "baseline",
    "baselines",
    "consistency",
    "isothermal",
]


def __getattr__(name: str) -> Any:
    """Former names, and names of other packages."""
    if name == "as_player":
        text = "smpl.controllers.as_player is deprecated, use smpl.policies.as_policy"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        return as_policy
    hint = of_attribute(__name__, name, __all__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}{hint and f'; {hint}'}", name=name)
