"""smpl: process models in a declarative language, compiled to machine code, as Gymnasium environments.

    import gymnasium, smpl
    env = gymnasium.make("smpl/Reactor-v0")

Importing the package registers the environments. `smpl.compile` makes a model of any `.eq` file and `smpl.Env(model)`
an environment of it.
"""

from smpl._files import announce_library
from smpl._native import CompileError, Diagnostic, ScenarioError, SimulationError, __version__
from smpl._registry import register_envs
from smpl.envs import Env
from smpl.identification import Fit, fit
from smpl.model import Model, compile
from smpl.vector import VectorEnv, make_vec

__all__ = [
    "CompileError",
    "Diagnostic",
    "Env",
    "Fit",
    "Model",
    "ScenarioError",
    "SimulationError",
    "VectorEnv",
    "__version__",
    "compile",
    "fit",
    "make_vec",
    "register_envs",
]

announce_library()
register_envs()
