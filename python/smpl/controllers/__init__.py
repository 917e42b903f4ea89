"""Controllers, estimators and baselines. They give actions in physical units, by the names of any model."""

from smpl.controllers.adapt import Function, Noisy, as_player
from smpl.controllers.base import Constant, Controller, Nominal, OpenLoop, Policy, Uniform
from smpl.controllers.baselines import baseline, baselines
from smpl.controllers.bayesian import BayesianOptimization
from smpl.controllers.beer import Profile, isothermal
from smpl.controllers.kalman import Consistency, ExtendedKalmanFilter, consistency
from smpl.controllers.lqr import LQG, LQR
from smpl.controllers.moving_horizon import MovingHorizonEstimator
from smpl.controllers.nmpc import NMPC
from smpl.controllers.pid import PID, Cascade, Loops
from smpl.controllers.reactor import Proportional
from smpl.controllers.sampling import SamplingMPC

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
    "SamplingMPC",
    "Uniform",
    "as_player",
    "baseline",
    "baselines",
    "consistency",
    "isothermal",
]
