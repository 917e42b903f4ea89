"""Many episodes of any controller or policy, for collection, evaluation and benchmark.

A `Task` describes the environment, a `Plan` the episodes (seeds, starts, controllers, noise). `run`
makes them in one native batch if the controllers can act on many environments at once, else one by
one. Episode i of a plan depends on the plan and on i alone.
"""

from smpl.learning.agents import Agent, agent
from smpl.learning.plan import Plan, Task
from smpl.learning.policy_files import load_policy
from smpl.learning.running import RunError, run
from smpl.learning.saved import save_policy
from smpl.learning.starts import Starts
from smpl.loop import Job, Settings

__all__ = [
    "Agent",
    "Job",
    "Plan",
    "RunError",
    "Settings",
    "Starts",
    "Task",
    "agent",
    "load_policy",
    "run",
    "save_policy",
]
